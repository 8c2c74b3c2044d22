"""The reference engine: toppra itself (Pham & Pham 2018). The one doorway to the library.

Same rows, same grid, same answer as timing.recursion; about a hundred times slower. Each piece is scaled so that its
length and its largest speed are 1, as the solver compares with absolute tolerances.
"""

from __future__ import annotations

import logging
from itertools import pairwise

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import CabsliceError


def retime(a: Array, b: Array, top: Array, step: Array, nodes: Array) -> Array:
    """Same arguments and answer as timing.recursion.retime. Raises CabsliceError where toppra finds no solution."""
    x = np.zeros(len(top))
    for first, last in pairwise(nodes):
        part = slice(first, last)
        x[part] = _piece(a[part], b[part], top[part], step[first:last - 1])
    return x


def _piece(a: Array, b: Array, top: Array, step: Array) -> Array:
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.interpolator import SplineInterpolator

    logging.getLogger("toppra").setLevel(logging.ERROR)
    length, fastest = float(step.sum()), float(top.max())
    grid = np.concatenate(([0.0], np.cumsum(step))) / length
    grid[-1] = 1.0
    constraint = _rows(toppra, a * (fastest / length), b * fastest, top / fastest)
    path = SplineInterpolator([0.0, 1.0], [[0.0], [1.0]])
    _, rate, _ = TOPPRA([constraint], path, gridpoints=grid, solver_wrapper="seidel").compute_parameterization(0.0, 0.0)
    if rate is None or not np.isfinite(rate).all():
        raise CabsliceError("toppra found no timing for a piece of the path; try --engine compiled")
    return rate**2 * fastest


def _rows(toppra, a: Array, b: Array, top: Array):
    """Rows a u + b x <= 1 and 0 <= x <= top as a constraint of toppra, imposed at both ends of each interval."""

    class Rows(toppra.constraint.LinearConstraint):
        def __init__(self) -> None:
            super().__init__()
            self.identical = True

        def compute_constraint_params(self, path, gridpoints):
            count = a.shape[1]
            bounds = np.stack((np.zeros(len(top)), top), axis=1)
            both_ends = toppra.constraint.canlinear_colloc_to_interpolate(
                a, b, np.zeros_like(a), np.eye(count), np.ones(count), bounds, None, gridpoints, identical=True)
            return (*both_ends[:5], None, bounds)

    return Rows()
