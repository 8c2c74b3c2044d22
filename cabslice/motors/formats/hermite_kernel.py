"""Where to put knots: the longest cubic Hermite pieces that stay within a tolerance of every row, compiled.

Legend
    v, s     values (n, c) and slopes per row (n, c)        h    rows from knot a to knot b
    x        share of the way, (i - a) / h                   H = (1 + 2x)(1-x)^2 v_a + x (1-x)^2 h s_a
    tol      (c,) largest deviation allowed                      + x^2 (3 - 2x) v_b + x^2 (x-1) h s_b
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def fits(v, s, tol, a, b):
    """Whether the piece from row a to row b passes all rows between."""
    h = b - a
    for i in range(a + 1, b):
        x = (i - a) / h
        y = 1.0 - x
        p, q, r, t = (1.0 + 2.0 * x) * y * y, x * y * y * h, x * x * (3.0 - 2.0 * x), -x * x * y * h
        for c in range(v.shape[1]):
            if abs(p * v[a, c] + q * s[a, c] + r * v[b, c] + t * s[b, c] - v[i, c]) > tol[c]:
                return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def longest(v, s, tol, a, guess):
    """Rows of a piece from row a that fits, as many as doubling and halving finds; at least one."""
    most = len(v) - 1 - a
    good, bad, trial = 1, most + 1, min(max(guess, 2), most)
    while bad - good > 1:
        if trial > good and fits(v, s, tol, a, a + trial):
            good = trial
        elif trial > good:
            bad = trial
        trial = min(2 * good, most) if bad > most and 2 * good < bad else (good + bad) // 2
    return good


@njit(cache=True, nogil=True, error_model="numpy")
def knots(v, s, tol):
    """Rows (K,) at which pieces meet, the first and the last row among them."""
    out, count, at, span = np.zeros(len(v), np.int64), 1, 0, 4
    while at < len(v) - 1:
        span = longest(v, s, tol, at, span)
        at += span
        out[count] = at
        count += 1
    return out[:count]
