"""What must hold with the nozzle at a place, and how long it is proven to hold around it (see survey).

Legend
    R        radius of the ball of nozzle positions, mm        A_i, b_i   exit point and attachment of cable i
    drift_i  what A_i can move while the nozzle is in the ball (exits.exit_drift)
    n        unit vector between the nearest points of two cables
    W t = w  equilibrium under gravity; the platform is level, so w is the same everywhere
    H_i      second derivative of cable length i: u_i changes by -H_i dq (pulley.hessian), |H_i| <= lambda_i
    G        sum of t_i [H_i ; c_i x H_i]: (W - W') t = G dq + remainder, for W' at a shift dq
    g_i      (1 + |c_i|^2/L^2)^1/2, L the size of the platform: moments are divided by it

Turning.  Where the platform turns by up to w in the ball (exits.turned_by), attachment i moves by up to R + w |d_i|,
and two of them to each other by w |c_j - c_i|; below R stands for the first and the second is taken off.

Two cables.  Attachments shift together, so along n their distance does not change at all; gap' >= the least of
n.(b_j - b_i), n.(A_j - A_i) - drift_i - drift_j, n.(b_j - A_i) - R - drift_i, n.(A_j - b_i) - R - drift_j.
Where both nearest points lie inside the cables, at shares s_i and s_j of the way A to b, n turns with them: n' = n + m,
m in the span of u_i' = b_i' - A_i' and u_j', at right angles to both. Then |n'|^2 = 1 - |m|^2 and n' . (A_j' - A_i') =
d (1 - |m|^2) + n' . v, v = (s_j - s_i) dq + (1 - s_j) dA_j - (1 - s_i) dA_i, so that d' >= d (1 - |m|^2)^1/2 - |v|;
|m| is at most what n . u_i' and n . u_j' are, over the smaller singular value of [u_i' u_j'].

Tension.  Let t balance at the place with slack s_i to its bounds, P = W^+, e = (W - W') t. Then t + P y with
y = (1 + (W' - W) P)^-1 e balances at the shifted place, and with k = |W' - W| |P| < 1
|P y|_i <= |(P G)_i| R + |P| (remainder + k/(1 - k) |e|).  Where that is below s_i for all cables, a feasible tension
exists in the whole ball; a turn of the platform adds to e what levers, attachments and the weight's moment change by.
|remainder| <= c/2 lambda^2 R^2 sum t_i g_i, with c = 2/3^(1/2) for eyelets (second
derivative of a unit vector) and c = 7 + d/l for pulleys (angles of the swivel and in its plane, each with gradient and
curvature).
"""

from __future__ import annotations

import numpy as np

from cabslice.arrays import Array
from cabslice.feasibility.exits import exit_drift, hung, lines_at, pulley_distances, tip_shift, turned_by
from cabslice.feasibility.survey import Judge
from cabslice.robot.clearance import closest, share_an_end
from cabslice.robot.model import NEWTON, Robot, nozzle_poses
from cabslice.robot.nullspace import subsets
from cabslice.robot.pulley import CableLines, hessian
from cabslice.robot.reach import margins
from cabslice.robot.rotation import skew
from cabslice.robot.tension import nearest
from cabslice.robot.wrench import required_wrench, wrench_matrix

USED = 0.8           # share of the margin that the tension of a proof keeps to every bound


def pulleys(robot: Robot) -> Judge:
    """Columns (2 m): rho - r_p (inf for eyelets) and d - r_p of each cable, mm: both must be above 0."""

    def judge(places: Array, radii: Array) -> tuple[Array, Array]:
        rho, d = pulley_distances(robot, places)
        swivel = np.where(robot.pulley_radii > 0, rho - robot.pulley_radii, np.inf)
        excess = np.concatenate((swivel, d - robot.pulley_radii), axis=1)
        excess = np.where(excess > 0, excess, np.minimum(excess, -1e-9))
        return excess, excess - np.tile(tip_shift(robot, places, radii), 2)

    return judge


def ends_over_bed(robot: Robot, grow: Array) -> Judge:
    """Columns (2 m): distance of exit points and of attachments to the bed plate, less grow (m,), mm.

    A plate that slopes counts as a level one at the height of its highest corner.
    """
    assert robot.bed_size is not None
    half = robot.bed_size / 2
    top = float(half @ np.abs(robot.bed_slope))

    def judge(places: Array, radii: Array) -> tuple[Array, Array]:
        exits = lines_at(robot, places).exit - robot.bed_origin
        ends = np.concatenate((exits, places[:, None] + hung(robot, places)), axis=1)
        out = np.concatenate((np.abs(ends[..., :2]) - half, ends[..., 2:] - top), axis=2)
        inside = np.minimum(out.max(axis=2), 0.0)
        excess = np.linalg.norm(np.maximum(out, 0.0), axis=2) + inside - np.tile(grow, 2)
        moved = exit_drift(robot, places, radii), tip_shift(robot, places, radii)
        return excess, excess - np.concatenate(moved, axis=1)

    return judge


def judged_pairs(robot: Robot) -> Array:
    """(P, 2) int: pairs of cables, from 0, that do not share an end."""
    return subsets(robot.cables, 2)[~share_an_end(robot)]


def pair_limits(robot: Robot) -> Array:
    """(P,) mm: radii and the larger clearance of each judged pair."""
    one, other = judged_pairs(robot).T
    return robot.cable_radii[one] + robot.cable_radii[other] + np.maximum(robot.clearance[one], robot.clearance[other])


def cable_pairs(robot: Robot) -> Judge:
    """Columns (P): distance of the cables of each judged pair less its limit, mm."""
    chosen, limits = ~share_an_end(robot), pair_limits(robot)
    one, other = judged_pairs(robot).T
    between = np.linalg.norm(robot.attachments[other] - robot.attachments[one], axis=1)

    def judge(places: Array, radii: Array) -> tuple[Array, Array]:
        lines = lines_at(robot, places)
        found = closest(robot, nozzle_poses(robot, places), lines=lines)
        distance, s, t = (column[:, chosen] for column in (found.distance, found.first, found.second))
        exits, tips = (lines.exit[:, one], lines.exit[:, other]), (lines.tip[:, one], lines.tip[:, other])
        lines_of = tips[0] - exits[0], tips[1] - exits[1]
        n = exits[1] + t[..., None] * lines_of[1] - exits[0] - s[..., None] * lines_of[0]
        n /= np.maximum(distance, 1e-12)[..., None]
        drift, shift = exit_drift(robot, places, radii), tip_shift(robot, places, radii)
        drifts, shifts = (drift[:, one], drift[:, other]), (shift[:, one], shift[:, other])
        proven = np.minimum.reduce((
            _along(n, tips[1] - tips[0]) - turned_by(robot, places, radii[:, None])[:, None] * between,
            _along(n, exits[1] - exits[0]) - drifts[0] - drifts[1],
            _along(n, tips[1] - exits[0]) - drifts[0] - shifts[1],
            _along(n, exits[1] - tips[0]) - drifts[1] - shifts[0],
        ))
        inside = (s > 0) & (s < 1) & (t > 0) & (t < 1)
        turning = np.where(inside, _turned_gap(distance, s, t, lines_of, drifts, shifts, radii[:, None]), -np.inf)
        return distance - limits, np.minimum(np.maximum(proven, turning), distance) - limits

    return judge


def _turned_gap(
    distance: Array, s: Array, t: Array, ways: tuple[Array, Array], drifts: tuple[Array, Array],
    shifts: tuple[Array, Array], radius: Array,
) -> Array:
    """Proven distance (K, P) mm of cables that are nearest inside both, with the direction between them turning."""
    a, c, b = _along(ways[0], ways[0]), _along(ways[1], ways[1]), _along(ways[0], ways[1])
    smaller = np.sqrt(np.maximum((a + c) / 2 - np.hypot((a - c) / 2, b), 0.0))
    moved = np.hypot(shifts[0] + drifts[0], shifts[1] + drifts[1])
    m = moved / np.maximum(smaller - moved, 1e-9)
    shift = np.abs(t - s) * radius + (1 - s) * drifts[0] + (1 - t) * drifts[1]
    shift = shift + s * (shifts[0] - radius) + t * (shifts[1] - radius)
    return np.where(m < 1, distance * np.sqrt(np.maximum(1 - m**2, 0.0)) - shift, -np.inf)


def tensions(robot: Robot) -> Judge:
    """One column: how far inside their bounds all tensions can stay under gravity, N; negative: not at all."""

    def judge(places: Array, radii: Array) -> tuple[Array, Array]:
        poses, lines = nozzle_poses(robot, places), lines_at(robot, places)
        wrench = wrench_matrix(robot, poses, masked=True, lines=lines)
        needed = required_wrench(robot, poses, masked=True)
        margin = margins(wrench, needed, robot.tension_min, robot.tension_max)
        proven = np.full(len(places), -np.inf)
        good = np.flatnonzero(margin > 0)
        if len(good):
            kept = USED * margin[good, None]
            lower, upper = robot.tension_min + kept, robot.tension_max - kept
            tension = nearest(wrench[good], needed[good], lower, upper, robot.tension_reference).tension
            slack = np.minimum(tension - robot.tension_min, robot.tension_max - tension)
            change = _tension_change(robot, places[good], radii[good], lines, good, wrench[good], tension)
            proven[good] = np.nan_to_num((slack - change).min(axis=1), nan=-np.inf)
        return margin[:, None], np.minimum(proven, margin)[:, None]

    return judge


def _tension_change(
    robot: Robot, places: Array, radii: Array, lines: CableLines, rows: Array, wrench: Array, tension: Array
) -> Array:
    """(K, m) N: by how much the tension that balances can differ within the balls; inf where nothing is proven."""
    lever, angle = np.linalg.norm(robot.attachments, axis=1), turned_by(robot, places, radii[:, None])
    size = max(float(np.sqrt((lever**2).mean())), 1.0)
    scale = np.repeat([1.0, 1.0 / size], 3)[robot.freedoms]
    inverse = np.linalg.pinv(wrench * scale[:, None])
    norm = np.linalg.norm(inverse, ord=2, axis=(1, 2))
    pull = tension[..., None, None] * hessian(lines)[rows]
    turn = skew(lines.lever[rows]) @ pull
    change = np.concatenate((pull, turn), axis=2).sum(axis=1)[:, robot.freedoms] * scale[:, None]
    slopes = np.linalg.norm(inverse @ change, axis=2)
    shift = tip_shift(robot, places, radii)
    bend, curve = _turning(robot, places, shift)
    weights = np.hypot(1.0, lever / size)
    turned, aside = angle[:, None] * lever / size, shift - radii[:, None]
    moved = (tension * (weights * bend * shift + turned)).sum(axis=1)
    rest = (tension * (weights * (curve * shift**2 / 2 + bend * aside) + turned)).sum(axis=1)
    weight = robot.mass * NEWTON * np.linalg.norm(robot.gravity) * np.linalg.norm(robot.centre_of_mass) / size
    moved, rest = moved + weight * angle, rest + weight * angle
    k = np.sqrt(((weights * bend * shift + turned) ** 2).sum(axis=1)) * norm
    with np.errstate(divide="ignore"):
        more = np.where(k < 1, norm * (rest + k / np.maximum(1 - k, 0.0) * moved), np.inf)
    return slopes * radii[:, None] + more[:, None]


def _turning(robot: Robot, places: Array, shift: Array) -> tuple[Array, Array]:
    """Bounds (K, m) of the first and second derivative of the unit vectors, 1/mm and 1/mm^2, where attachments move
    by up to shift (K, m) mm."""
    r = robot.pulley_radii
    rho, d = np.maximum(np.stack(pulley_distances(robot, places)) - shift, 1e-9)
    free = np.sqrt(np.maximum(d**2 - r * r, 1e-18))
    shortest = np.where(r > 0, np.minimum(free, rho), free)
    return 1 / shortest, np.where(r > 0, 7 + d / free, 2 / np.sqrt(3)) / shortest**2


def _along(n: Array, vectors: Array) -> Array:
    return np.einsum("kpi,kpi->kp", n, vectors)
