"""What wrenches the cables can supply within their bounds: exact rows, margins and facets.

Legend
    W t = w, t_min <= t <= t_max        t_mid = (t_min + t_max)/2, t_half = (t_max - t_min)/2
    t_p   least-norm tension of w       N  orthonormal null space of W, rows h_i
    mu    elementary vector of the row space of W (r + 1 cables; 3 for 8 cables and 6 freedoms)

mu . t does not depend on the choice lambda in t = t_p + N lambda, so

    |mu . (t_p - t_mid)| <= |mu| . t_half        for every mu

is necessary; over all elementary vectors it is also sufficient (Rockafellar 1969, The elementary vectors of a subspace;
the same facets as hyperplane shifting: Bouchard, Moore and Gosselin 2010; Gouttefarde and Krut 2010): 56 two-sided
rows, 112 facets, for 8 cables. They are affine in w, so they serve retiming. Draw the bounds in by delta and the right
side falls by |mu|_1 delta: the least (|mu| . t_half - |mu . (t_p - t_mid)|)/|mu|_1 is the margin in N.
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.robot.model import Robot
from cabslice.robot.nullspace import Balance, balance, blocks, elementary_vectors, subsets
from cabslice.robot.wrench import required_wrench, wrench_matrix

PARALLEL = 1e-9      # |mu|_1 below this: the rows of N are dependent and the subset says nothing

Members = tuple[Array, list[Array]]
Bounds = tuple[Array, Array]      # middle and half range, (m, 1) or (m, K)


def tension_rows(
    wrench: Array, base: Array, along_u: Array, along_x: Array, tension_min: Array, tension_max: Array
) -> tuple[Array, Array, Array, Array]:
    """Rows a, b, lo, hi, each (R, K): lo <= a u + b x <= hi in every row if and only if a tension within the bounds
    exists with W t = base + along_u u + along_x x.

    wrench (K, n, m); base, along_u, along_x (K, n), N and N mm, per unit of u and x; bounds (m,) or (K, m) N.
    R = C(m, m - n + 1): 56 for 8 cables and 6 freedoms. Scaled so that hi - lo = 2, whatever the units. A subset of
    parallel rows says nothing: a = b = 0, lo = -inf, hi = inf. A singular pose admits nothing: a = b = 0, lo = 1,
    hi = -1. The answer takes 4 R K doubles: work in blocks of poses beyond 10^5.
    Raises ValueError where cables are fewer than freedoms, or a lower bound is not below its upper bound.
    """
    count, freedoms, cables = wrench.shape
    middle, half = bounds_of(tension_min, tension_max, cables)
    out = np.empty((4, len(subsets(cables, cables - freedoms + 1)), count))
    for part in blocks(count):
        state = balance(wrench[part], base[part], along_u[part], along_x[part])
        found = elementary_vectors(state.null)
        width, _ = _widths(found, part_of(half, part), state.regular)
        scale = 1.0 / width
        slope_u, slope_x, lowest, highest = out[:, :, part]
        np.multiply(_product(found, state.particular[:, 1]), scale, out=slope_u)
        np.multiply(_product(found, state.particular[:, 2]), scale, out=slope_x)
        centre = _product(found, part_of(middle, part) - state.particular[:, 0]) * scale
        reach = np.where(np.isinf(width), np.inf, 1.0)
        reach[:, ~state.regular] = -1.0
        np.subtract(centre, reach, out=lowest)
        np.add(centre, reach, out=highest)
    return out[0], out[1], out[2], out[3]


def margins(wrench: Array, required: Array, tension_min: Array, tension_max: Array) -> Array:
    """The largest delta (K,) N such that some tension balances and stays delta inside every bound.

    Negative: no feasible tension, by how much the bounds miss. -inf at a singular pose. Never above half the narrowest
    range of tension. Shapes, units and errors as tension_rows; required (K, n).
    """
    count, _, cables = wrench.shape
    middle, half = bounds_of(tension_min, tension_max, cables)
    out = np.empty(count)
    for part in blocks(count):
        out[part] = margin_of(balance(wrench[part], required[part]), part_of(middle, part), part_of(half, part))
    return out


def margin_of(state: Balance, middle: Array, half: Array) -> Array:
    """Margin (K,) N of the first right-hand side of a balance; middle and half of the bounds (m, 1) or (m, K)."""
    found = elementary_vectors(state.null)
    width, size = _widths(found, half, state.regular)
    slack = (width - np.abs(_product(found, state.particular[:, 0] - middle))) / size
    least = np.minimum(slack.min(axis=0), half.min(axis=0))
    return np.where(state.regular, least, -np.inf)


def available_wrenches(wrench: Array, tension_min: Array, tension_max: Array) -> tuple[Array, Array]:
    """Facets of the available wrench set {W t: t_min <= t <= t_max}: normals (K, F, n), offsets (K, F) N.

    A wrench w can be supplied if and only if normals @ w <= offsets. F = 2 C(m, m - n + 1): 112 for 8 cables and 6
    freedoms. Scaled so that offsets - normals @ w are newtons of cable tension, the least of them being margins();
    subsets that say nothing have normal 0 and offset inf; a singular pose has normals 0 and offsets -inf.
    Shapes, units and errors as tension_rows.
    """
    count, freedoms, cables = wrench.shape
    middle, half = bounds_of(tension_min, tension_max, cables)
    rows = len(subsets(cables, cables - freedoms + 1))
    normals, offsets = np.empty((count, 2 * rows, freedoms)), np.empty((count, 2 * rows))
    for part in blocks(count):
        unit = np.broadcast_to(np.eye(freedoms)[:, None], (freedoms, len(wrench[part]), freedoms))
        state = balance(wrench[part], *unit)
        found = elementary_vectors(state.null)
        width, size = _widths(found, part_of(half, part), state.regular)
        scale = np.where(np.isinf(width), 0.0, 1.0 / size)
        for freedom in range(freedoms):
            normals[part, :rows, freedom] = (_product(found, state.particular[:, freedom]) * scale).T
        normals[part, rows:] = -normals[part, :rows]
        centre = _product(found, np.broadcast_to(part_of(middle, part), state.null[:, 0].shape)) * scale
        reach = width / size
        reach[:, ~state.regular] = -np.inf
        offsets[part, :rows], offsets[part, rows:] = (reach + centre).T, (reach - centre).T
    return normals, offsets


def pose_margins(robot: Robot, poses: Array, required: Array | None = None) -> Array:
    """margins (K,) N of a robot at poses (K, 6) under `required` (K, 6), its own weight where that is absent."""
    needed = required_wrench(robot, poses) if required is None else np.asarray(required, dtype=float)
    wrench = wrench_matrix(robot, poses, masked=True)
    return margins(wrench, needed[:, robot.freedoms], robot.tension_min, robot.tension_max)


def facets(robot: Robot, poses: Array) -> tuple[Array, Array]:
    """available_wrenches of a robot at poses (K, 6): normals (K, F, 6), offsets (K, F) N; 112 facets for 8 cables.

    Normals are 0 along freedoms the robot does not hold. Raises PoseError as wrench_matrix.
    """
    wrench = wrench_matrix(robot, poses, masked=True)
    held, offsets = available_wrenches(wrench, robot.tension_min, robot.tension_max)
    if robot.freedoms.all():
        return held, offsets
    normals = np.zeros((*offsets.shape, 6))
    normals[:, :, robot.freedoms] = held
    return normals, offsets


def _product(found: Members, columns: Array) -> Array:
    """mu . columns (S, K), columns (m, K)."""
    members, weights = found
    total = weights[0] * columns[members[:, 0]]
    for p in range(1, len(weights)):
        total += weights[p] * columns[members[:, p]]
    return total


def _widths(found: Members, half: Array, regular: Array) -> tuple[Array, Array]:
    """|mu| . t_half, inf where the subset says nothing or the pose is singular, and |mu|_1: both (S, K)."""
    members, weights = found
    first = np.abs(weights[0])
    width, size = first * half[members[:, 0]], first
    for p in range(1, len(weights)):
        weight = np.abs(weights[p])
        width += weight * half[members[:, p]]
        size = size + weight
    silent = (size < PARALLEL) | ~regular
    width[silent] = np.inf
    size[silent] = 1.0
    return width, size


def bounds_of(tension_min: Array, tension_max: Array, cables: int) -> Bounds:
    """Middle and half range of bounds given as (m,) or (K, m), batch last: (m, 1) or (m, K)."""
    lower, upper = (np.atleast_2d(np.asarray(bound, dtype=float)).T for bound in (tension_min, tension_max))
    lower, upper = np.broadcast_arrays(lower, upper)
    if len(lower) != cables:
        raise ValueError(f"tension bounds for {len(lower)} cables, expected {cables}")
    if not (lower < upper).all():
        raise ValueError("a lower tension bound is not below its upper bound")
    return (lower + upper) / 2, (upper - lower) / 2


def part_of(column: Array, part: slice) -> Array:
    """The poses of a block; a column (m, 1) is shared by all of them."""
    return column if column.shape[1] == 1 else column[:, part]
