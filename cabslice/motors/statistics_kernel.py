"""Largest values of columns and the rows that have them, compiled: one pass over each column."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def largest(values, absolute, sign, first, best, where):
    """best (m,) and its row where (m,), raised by values (n, m) times sign, or |values|; `first` is their first row."""
    for i in range(len(values)):
        for j in range(values.shape[1]):
            value = abs(values[i, j]) if absolute else sign * values[i, j]
            if value > best[j]:
                best[j] = value
                where[j] = first + i


@njit(cache=True, nogil=True, error_model="numpy")
def bends(tail, values, first, best, where):
    """The same of |x[i+1] - 2 x[i] + x[i-1]| over the rows of tail (k, m) followed by values (n, m)."""
    k = len(tail)
    for j in range(values.shape[1]):
        for i in range(1, k + len(values) - 1):
            low = tail[i - 1, j] if i - 1 < k else values[i - 1 - k, j]
            mid = tail[i, j] if i < k else values[i - k, j]
            high = tail[i + 1, j] if i + 1 < k else values[i + 1 - k, j]
            value = abs(high - 2 * mid + low)
            if value > best[j]:
                best[j] = value
                where[j] = first + i


@njit(cache=True, nogil=True, error_model="numpy")
def add_squares(values, sums):
    """sums (m,) and the squares of values (n, m)."""
    for i in range(len(values)):
        for j in range(values.shape[1]):
            sums[j] += values[i, j] * values[i, j]


def nothing(columns: int) -> tuple[np.ndarray, np.ndarray]:
    """best and where before the first row."""
    return np.full(columns, -np.inf), np.zeros(columns, np.int64)
