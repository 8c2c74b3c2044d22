"""Where to put knots: straight pieces that stay within a tolerance of every row, compiled.

Legend
    v        values (n, c)          tol      (c,) largest deviation allowed
    forced   (n,) rows that must be knots    low, high   (c,) slopes from the knot that pass all rows since
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def chords(v, tol, forced):
    """Rows (K,) at which pieces meet, the first and the last row among them."""
    n, c = v.shape
    out, count, at = np.zeros(n, np.int64), 1, 0
    low, high = np.full(c, -np.inf), np.full(c, np.inf)
    i = 1
    while i < n:
        fits = not forced[i - 1] or i - 1 == at
        for k in range(c):
            slope = (v[i, k] - v[at, k]) / (i - at)
            fits = fits and low[k] <= slope <= high[k]
        if not fits:
            at = i - 1
            out[count] = at
            count += 1
            low[:], high[:] = -np.inf, np.inf
        for k in range(c):
            rise, h = v[i, k] - v[at, k], i - at
            low[k] = max(low[k], (rise - tol[k]) / h)
            high[k] = min(high[k], (rise + tol[k]) / h)
        i += 1
    if n > 1:
        out[count] = n - 1
        count += 1
    return out[:count]
