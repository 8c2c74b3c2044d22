"""Compiled shortcut of tension.nearest: where the balancing tension nearest to the reference keeps the bounds, it is
the answer, and no polygon is needed (most poses of most prints).

Legend
    t_0 = t_ref + W^T (W W^T)^-1 (w - W t_ref)     n freedoms, m cables; rows of W scaled to like size for the Cholesky
"""

from __future__ import annotations

from math import sqrt

from cabslice.compiled import compiled

WEAK = 1e-8     # a pivot this small beside the largest: nearly singular, left to the careful method


@compiled
def fill_unbounded(wrench, required, reference, tension, sound, scratch):
    """Fill tension (K, m) with t_0 and sound (K,) with whether W W^T was well enough conditioned to trust it.

    wrench (K, n, m), required (K, n), reference (m,); scratch (n + 2, n).
    """
    count, n, m = wrench.shape
    square, missing, size = scratch[:n], scratch[n], scratch[n + 1]
    for k in range(count):
        w = wrench[k]
        for i in range(n):
            total, norm = required[k, i], 0.0
            for c in range(m):
                total -= w[i, c] * reference[c]
                norm += w[i, c] * w[i, c]
            size[i] = 1.0 / sqrt(norm) if norm > 0.0 else 0.0
            missing[i] = total * size[i]
        sound[k] = True
        for i in range(n):
            for j in range(i + 1):
                total = 0.0
                for c in range(m):
                    total += w[i, c] * w[j, c]
                total *= size[i] * size[j]
                for c in range(j):
                    total -= square[i, c] * square[j, c]
                if i > j:
                    square[i, j] = total / square[j, j]
                elif total > WEAK:
                    square[i, i] = sqrt(total)
                else:
                    sound[k] = False
                    square[i, i] = 1.0
        for i in range(n):
            for c in range(i):
                missing[i] -= square[i, c] * missing[c]
            missing[i] /= square[i, i]
        for i in range(n - 1, -1, -1):
            for c in range(i + 1, n):
                missing[i] -= square[c, i] * missing[c]
            missing[i] /= square[i, i]
        for c in range(m):
            total = reference[c]
            for i in range(n):
                total += w[i, c] * size[i] * missing[i]
            tension[k, c] = total
