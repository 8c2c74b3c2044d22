"""Tensions by their quadratic programme, many poses at once: a reference apart from null spaces and polygons.

Legend
    minimise |t - t_r|^2  with  W t = w,  t_min <= t <= t_max;   y multipliers of W t = w, one a freedom
    t(y) = min(max(t_r + W^T y, t_min), t_max): every t(y) that balances is the minimum (Karush, Kuhn, Tucker)
    W is taken with its moments over the largest lever, so that its entries are of order 1

W t(y) = w is solved by Newton's method on the free cables (semismooth: Qi and Sun 1993), which is exact once the
right cables are at bounds; what does not converge goes to the reference pose by pose (distributions.quadratic).
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.distributions import quadratic

ROUNDS = 12
CLOSE = 1e-11          # of the largest force: what W t(y) may miss
RIDGE = 1e-14


def projected(wrench: Array, required: Array, tension_min: Array, tension_max: Array, reference: Array) -> Array:
    """Tensions (K, m) N, nan where there are none; wrench (K, n, m), required (K, n), bounds and reference (m,) N."""
    size = np.abs(wrench).max(axis=2, keepdims=True)
    matrix, side = wrench / size, required / size[:, :, 0]
    close = CLOSE * (np.abs(side).max() + np.abs(tension_max).max())
    y, tension = np.zeros_like(side), np.empty((len(wrench), wrench.shape[2]))
    left = np.arange(len(wrench))
    for _ in range(ROUNDS):
        wanted = reference + np.einsum("knm,kn->km", matrix[left], y[left])
        tension[left] = np.clip(wanted, tension_min, tension_max)
        off = side[left] - np.einsum("knm,km->kn", matrix[left], tension[left])
        going = ~(np.abs(off).max(axis=1) <= close)
        left, off, free = left[going], off[going], (wanted == tension[left])[going]
        if not len(left):
            return tension
        held = matrix[left] * free[:, None]
        square = held @ held.swapaxes(1, 2) + RIDGE * np.eye(matrix.shape[1])
        y[left] += np.linalg.solve(square, off[..., None])[..., 0]
    tension[left] = quadratic(wrench[left], required[left], tension_min, tension_max, reference).tension
    return tension
