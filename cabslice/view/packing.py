"""Columns of numbers as text inside a page: few bits each, exact to a stated step.

Legend
    q        round((value - low) / step), int64: what is kept; value ~ low + step q, wrong by at most step / 2
    delta    q[i] - q[i-1] (the first counted from 0), zigzag: 2 d for d >= 0, -2 d - 1 below, so that small is small
    planes   all lowest bytes, then all second bytes, ...: the higher planes are mostly zeros and deflate to nothing

A packed column is {n, bytes, low, step, data}: `bytes` planes of n bytes, deflated (RFC 1950), in base64. web/unpack.js
reads it.
"""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np

from cabslice.arrays import Array

LEVELS = 1 << 14     # steps a column of measured values is split into
EFFORT = 4           # of deflate: half the time of 6 for a few per cent of size


def packed(values: Array, step: float | None = None) -> dict[str, Any]:
    """A column (n,) of finite numbers; without `step` its range is split into LEVELS. Raises ValueError otherwise."""
    values = np.asarray(values, float)
    if not np.isfinite(values).all():
        raise ValueError("a column with a value that is not finite cannot be packed")
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
    if step is None:
        step = (high - low) / LEVELS or 1.0
    whole = np.rint((values - low) / step).astype(np.int64)
    change = np.diff(whole, prepend=0)
    coded = ((change << 1) ^ (change >> 63)).astype("<u8")
    count = max(1, -(-int(coded.max(initial=0)).bit_length() // 8))
    planes = coded.view(np.uint8).reshape(-1, 8)[:, :count].T
    data = base64.b64encode(zlib.compress(planes.tobytes(), EFFORT)).decode()
    return {"n": len(values), "bytes": count, "low": low, "step": step, "data": data}


def unpacked(column: dict[str, Any]) -> Array:
    """The values (n,) of a packed column."""
    raw = np.frombuffer(zlib.decompress(base64.b64decode(column["data"])), np.uint8)
    planes = raw.reshape(column["bytes"], column["n"]).astype(np.int64)
    coded = (planes << (8 * np.arange(column["bytes"]))[:, None]).sum(axis=0)
    return column["low"] + column["step"] * np.cumsum((coded >> 1) ^ -(coded & 1))
