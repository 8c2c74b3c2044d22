"""The linear algebra below statics: every tension that balances a wrench, for a whole batch of poses at once.

Legend
    W    wrench matrix (n, m): n freedoms, m cables           r = m - n  degree of redundancy
    Q R  Householder factors of W^T: W^T = Q[:, :n] R         N = Q[:, n:]  orthonormal null space, W N = 0
    t_p  = Q[:, :n] R^-T w, the least-norm tension with W t_p = w
    mu   elementary vector of the row space of W: r + 1 cables, the r x r minors of their rows of N (mu . N = 0)

Batches lie on the last axis here, so that each step is one sweep over contiguous poses. Householder needs no pivots:
N is orthonormal to rounding at every pose. Source: Golub and Van Loan, Matrix Computations, 5.1-5.2, 5.6.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

from cabslice.arrays import Array

SINGULAR = 1e-9      # a row of W nearer than this (relative) to the span of the rows above it: the pose is singular
BLOCK = 1024         # poses per sweep: the working set stays in the cache


@dataclass(frozen=True)
class Balance:
    """All tensions that balance: t = particular + null @ lambda. Batch on the last axis."""

    null: Array          # (m, r, K) orthonormal columns
    particular: Array    # (m, q, K) N, least-norm, one per right-hand side
    regular: Array       # (K,) bool: W has full rank; elsewhere the other two are finite but mean nothing


def blocks(count: int, size: int = BLOCK) -> Iterator[slice]:
    """Slices of at most `size` that cover range(count)."""
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))


def balance(wrench: Array, *sides: Array) -> Balance:
    """Null space and least-norm solutions of W t = side.

    wrench (K, n, m) with m >= n; each of sides (K, n). Units: those of side / wrench, so N for tensions.
    Raises ValueError where there are fewer cables than freedoms.
    """
    freedoms, cables = wrench.shape[1:]
    if cables < freedoms:
        raise ValueError(f"{cables} cables cannot hold {freedoms} freedoms: expected at least {freedoms} cables")
    work = np.ascontiguousarray(np.transpose(wrench, (2, 1, 0)))
    mirrors, diagonal, regular = _factor(work)
    solved = np.zeros((cables, len(sides) + cables - freedoms, wrench.shape[0]))
    for column, side in enumerate(sides):
        _solve_lower(work, diagonal, side.T, solved[:freedoms, column])
    for extra in range(cables - freedoms):
        solved[freedoms + extra, len(sides) + extra] = 1.0
    for row in reversed(range(freedoms)):
        _reflect(solved[row:], *mirrors[row])
    return Balance(null=solved[:, len(sides):], particular=solved[:, :len(sides)], regular=regular)


def _factor(work: Array) -> tuple[list[tuple[Array, Array]], list[Array], Array]:
    """Householder QR of work (m, n, K) in place: mirrors (v, 2/v.v), diagonal of R, full rank or not."""
    mirrors, diagonal = [], []
    regular = np.ones(work.shape[2], dtype=bool)
    size = np.einsum("ijk,ijk->jk", work, work)
    for column in range(work.shape[1]):
        mirror = work[column:, column].copy()
        square = np.einsum("ik,ik->k", mirror, mirror)
        regular &= square > SINGULAR**2 * size[column]
        square = np.where(regular, square, 1.0)
        pivot = -np.copysign(np.sqrt(square), mirror[0])
        scale = 1.0 / (square - pivot * mirror[0])
        mirror[0] -= pivot
        _reflect(work[column:, column + 1:], mirror, scale)
        mirrors.append((mirror, scale))
        diagonal.append(pivot)
    return mirrors, diagonal, regular


def _reflect(columns: Array, mirror: Array, scale: Array) -> None:
    """columns (p, q, K) <- (I - scale v v^T) columns, in place."""
    for column in range(columns.shape[1]):
        part = columns[:, column]
        part -= mirror * (np.einsum("ik,ik->k", mirror, part) * scale)


def _solve_lower(work: Array, diagonal: list[Array], side: Array, out: Array) -> None:
    """Forward substitution R^T y = side; R above the diagonal of work."""
    for row in range(len(diagonal)):
        value = side[row]
        if row:
            value = value - np.einsum("ik,ik->k", work[:row, row], out[:row])
        np.divide(value, diagonal[row], out=out[row])


@lru_cache(maxsize=32)
def subsets(cables: int, size: int) -> Array:
    """(S, size) int: all subsets of so many cables, in lexicographic order."""
    found = np.array(list(combinations(range(cables), size)), dtype=np.intp).reshape(-1, size)
    found.flags.writeable = False
    return found


@lru_cache(maxsize=32)
def _without_one(cables: int, size: int) -> Array:
    """(S, size) int: for each subset, the number of the subset that lacks its p-th member."""
    number = {members: i for i, members in enumerate(combinations(range(cables), size - 1))}
    found = [[number[s[:p] + s[p + 1:]] for p in range(size)] for s in combinations(range(cables), size)]
    return np.array(found, dtype=np.intp).reshape(-1, size)


def elementary_vectors(null: Array) -> tuple[Array, list[Array]]:
    """Members (S, r+1) and their weights mu, r + 1 arrays (S, K): sum_p mu_p N[member_p] = 0.

    null (m, r, K). Every support-minimal vector of the row space of W is among them, up to scale; a subset whose rows
    of N have rank below r gives mu = 0. For r = 2, mu = (h_j x h_k, h_k x h_i, h_i x h_j). Source: Rockafellar 1969.
    """
    cables, redundancy = null.shape[:2]
    minors = np.ones((1, null.shape[2]))
    for size in range(1, redundancy + 1):
        members, others = subsets(cables, size), _without_one(cables, size)
        column = null[:, size - 1]
        total = column[members[:, -1]] * minors[others[:, -1]]
        for p in range(size - 1):
            term = column[members[:, p]] * minors[others[:, p]]
            total = total + term if (size - 1 - p) % 2 == 0 else total - term
        minors = total
    others = _without_one(cables, redundancy + 1)
    weights = [minors[others[:, p]] * (-1.0) ** p for p in range(redundancy + 1)]
    return subsets(cables, redundancy + 1), weights
