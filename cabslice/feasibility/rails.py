"""Can a linear Delta follow this toolpath? What applies to a machine of rails and arms; what does not is said.

Legend
    q_k      height of carriage k (robot.delta): concave in x and y, so along a straight move it is lowest at an end
    bulge    along a move of length l it rises at most l^2 / 8 times its largest curvature L^2 / h^3 above the ends
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import InputError, ProfileError
from cabslice.feasibility.distance import PRECISION
from cabslice.feasibility.findings import Finding, Verdict
from cabslice.feasibility.obstacles import laying
from cabslice.robot.delta import Delta, arms, carriages, spans
from cabslice.robot.model import nozzle_poses
from cabslice.toolpath.path import Toolpath

NOT_APPLIED = ("Not applicable, it has no cables: tensions, cables against part, bed and each other. "
               "Not judged: arms and platform against the part, as their shapes are not in the profile.")


def check(toolpath: Toolpath, delta: Delta, *, bare: bool = False) -> Verdict:
    """Nozzle over the bed plate, arms that reach within the angle of their joints, carriages on their rails.

    Raises InputError where the toolpath lays nothing and that was not said (`bare`), ProfileError where the machine has
    no nozzle or no bed.
    """
    if delta.nozzle is None or delta.bed_size is None:
        raise ProfileError(delta.name, ["it has no nozzle or no bed: expected both, to print with."])
    if not bare and not laying(toolpath).any():
        raise InputError("The toolpath lays no bead: there is nothing to print.")
    count = len(toolpath.xyz)
    found = [*_over_bed(toolpath, delta)]
    told = [f"The nozzle at {count} points over the bed plate of {delta.bed_size[0]:g} x {delta.bed_size[1]:g} mm."]
    reach = _out_of_reach(toolpath, delta)
    margins: dict[str, float] = {}
    if reach:
        found += reach
        told.append("The reach of the arms; not the carriages, as there are places no arm reaches.")
    else:
        rails, margins = _on_rails(toolpath, delta)
        found += rails
        told.append(f"Arms within the angle of their joints and carriages on their rails at {count} points and along "
                    "the moves between them.")
    return Verdict((*told, NOT_APPLIED), tuple(found), margins)


def _over_bed(toolpath: Toolpath, delta: Delta) -> Iterator[Finding]:
    assert delta.bed_size is not None
    half = delta.bed_size / 2
    bead = laying(toolpath)
    over = (np.abs(toolpath.xyz[:, :2]) - half).max(axis=1)
    over = np.where(bead, over, -np.inf)
    at = int(np.argmax(over))
    if over[at] > PRECISION:
        axis = int(np.argmax(np.abs(toolpath.xyz[at, :2]) - half))
        yield _finding(toolpath, at, "bed", 0, float(abs(toolpath.xyz[at, axis])), float(half[axis]), "mm",
                       "the nozzle lays a bead beyond the edge of the bed plate", "Shift the part, or make it smaller.")


def _out_of_reach(toolpath: Toolpath, delta: Delta) -> list[Finding]:
    """The level distance an arm spans is convex along a move: what holds at both ends holds between."""
    poses = nozzle_poses(delta, toolpath.xyz)
    span = spans(delta, poses)
    most = delta.arm * float(np.sin(delta.arm_angle_max))
    found = []
    for rail in np.flatnonzero((span > most).any(axis=0)).tolist():
        at = int(np.argmax(span[:, rail]))
        value = float(np.degrees(np.arcsin(min(span[at, rail] / delta.arm, 1.0))))
        found.append(_finding(toolpath, at, "arm-angle", rail + 1, value, float(np.degrees(delta.arm_angle_max)), "deg",
                              f"arm {rail + 1} leans more than its joints allow", "Move the part towards the middle."))
    return found


def _on_rails(toolpath: Toolpath, delta: Delta) -> tuple[list[Finding], dict[str, float]]:
    poses = nozzle_poses(delta, toolpath.xyz)
    q, height = carriages(delta, poses), arms(delta, poses)[1]
    low, high = (float(value) for value in delta.travel)
    above = q + _bulge(delta, toolpath.xyz, height)
    found = []
    for rail in range(3):
        lowest, highest = int(np.argmin(q[:, rail])), int(np.argmax(above[:, rail]))
        if q[lowest, rail] < low:
            found.append(_finding(toolpath, lowest, "stroke", rail + 1, float(q[lowest, rail]), low, "mm",
                                  f"carriage {rail + 1} would be below the end of its rail", "Raise the bed."))
        if above[highest, rail] > high:
            found.append(_finding(toolpath, highest, "stroke", rail + 1, float(above[highest, rail]), high, "mm",
                                  f"carriage {rail + 1} would be above the end of its rail", "Make the part lower."))
    leaning = np.arccos(height.min() / delta.arm)
    return found, {"stroke_mm": float(min(q.min() - low, high - above.max())),
                   "arm_angle_deg": float(np.degrees(delta.arm_angle_max - leaning))}


def _bulge(delta: Delta, xyz: Array, height: Array) -> Array:
    """(N, 3) mm by which a carriage may rise above both ends of the move into each point."""
    length = np.linalg.norm(np.diff(xyz, axis=0, prepend=xyz[:1]), axis=1)
    least = np.minimum(height, np.roll(height, 1, axis=0))
    return np.asarray(length[:, None] ** 2 / 8 * delta.arm**2 / least**3)


def _finding(toolpath: Toolpath, at: int, code: str, rail: int, value: float, limit: float, unit: str, what: str,
             remedy: str) -> Finding:
    layer = int(toolpath.layer[at])
    x, y, z = (float(one) for one in toolpath.xyz[at])
    sentence = (f"layer {layer}: {what}, nozzle at x {x:.1f} y {y:.1f} z {z:.1f} mm: {value:.4g}, limit {limit:.4g} "
                f"{unit}.")
    return Finding(code, layer, (x, y, z), rail, value, limit, unit, sentence, remedy)
