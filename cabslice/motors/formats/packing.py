"""Columns of numbers as second differences of as few bits as they need, compiled.

Legend
    x   integers (n, c): rint(value / quantum)         d   x[i] - 2 x[i-1] + x[i-2], from row 2 on
    z   zigzag of d: 2d for d >= 0, -2d - 1 for d < 0   w   bits of the largest z of GROUP neighbouring rows
"""

# mypy: disable-error-code="assignment"
from __future__ import annotations

import numpy as np
from numba import njit

GROUP = 64
LARGEST = 2.0**60            # integers beyond have no second difference in 64 bits


@njit(cache=True, nogil=True, error_model="numpy")
def pack(values, quantum, seeds, widths, words):
    """Words used by values (n, c), or -1 where one is too large.

    Filled: seeds (c, 2) int64, x of the first two rows; widths (c, g) uint8; words uint64: w words for each group,
    channel after channel, z after z from the lowest bit on.
    """
    at, last, finer = 0, np.zeros(GROUP, np.uint64), 1.0 / quantum
    for c in range(values.shape[1]):
        before, now = 0, 0
        for i in range(min(2, len(values))):
            scaled = np.rint(values[i, c] * finer)
            if not abs(scaled) < LARGEST:
                return -1
            before, now = now, np.int64(scaled)
            seeds[c, i] = now
        for g in range(widths.shape[1]):
            first = 2 + g * GROUP
            count, bits = min(GROUP, len(values) - first), np.uint64(0)
            for k in range(count):
                scaled = np.rint(values[first + k, c] * finer)
                if not abs(scaled) < LARGEST:
                    return -1
                x = np.int64(scaled)
                d = x - 2 * now + before
                before, now = now, x
                last[k] = np.uint64((d << 1) ^ (d >> 63))
                bits |= last[k]
            width = 0
            while bits:
                width += 1
                bits >>= np.uint64(1)
            widths[c, g] = width
            last[count:] = 0
            _put(last, width, words[at:at + width])
            at += width
    return at


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _put(z, width, words):
    """GROUP numbers of `width` bits each into as many words."""
    held, filled, word = np.uint64(0), 0, 0
    for k in range(GROUP if width else 0):
        held |= z[k] << np.uint64(filled)
        filled += width
        if filled >= 64:
            words[word] = held
            word, filled = word + 1, filled - 64
            held = z[k] >> np.uint64(width - filled) if filled else np.uint64(0)


@njit(cache=True, nogil=True, error_model="numpy")
def unpack(seeds, widths, words, out):
    """The integers (n, c) int64 that `pack` was given, into out."""
    at, one = 0, np.uint64(1)
    for c in range(out.shape[1]):
        for i in range(min(2, len(out))):
            out[i, c] = seeds[c, i]
        for g in range(widths.shape[1]):
            first, width = 2 + g * GROUP, np.int64(widths[c, g])
            mask = ~np.uint64(0) if width == 64 else (one << np.uint64(width)) - one
            for k in range(min(GROUP, len(out) - first)):
                place = k * width
                word, shift = at + (place >> 6), np.uint64(place & 63)
                z = np.uint64(0)
                if width:
                    z = words[word] >> shift
                    if shift + np.uint64(width) > np.uint64(64):
                        z |= words[word + 1] << (np.uint64(64) - shift)
                    z &= mask
                d = np.int64(z >> one) ^ -np.int64(z & one)
                row = first + k
                out[row, c] = d + 2 * out[row - 1, c] - out[row - 2, c]
            at += width
