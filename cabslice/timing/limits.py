"""What limits the motion, in one form: rows  a u + b x <= 1  at each node, and the largest x whatever u is.

Legend
    u, x         d2s/dt2 (mm/s^2) and (ds/dt)^2 (mm^2/s^2) of the path parameter
    q', q''      derivatives of the platform by s: those of the nozzle where it is level; its acceleration is
                 q' u + q'' x
    L', L''      derivatives of the cable lengths by s: L' = J q', L'' = J q'' + q' H q'
    k, w         pressure advance and averaging window, s: the extruder is told E + k dE/dt. Averaged, d2E/dt2 is at
                 most a and ramps by 2 a / w, and a step j of dE/dt is j / w for w: so the extruder sees a (1 + 2 k/w),
                 steps of j (1 + k / w), and k (a + j / w) more speed
    two-sided row   lo <= a u + b x <= hi with lo < 0 < hi: rest is inside, and dividing by hi and by lo scales to 1
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.errors import ImpossibleError
from cabslice.robot.delta import Delta, Machine
from cabslice.robot.kinematics import length_accelerations
from cabslice.robot.model import NEWTON, Robot, nozzle_poses
from cabslice.robot.reach import tension_rows
from cabslice.robot.usable import TORQUE_SHARE, take_up, usable_tension_max
from cabslice.robot.winder import transmission_bounds
from cabslice.robot.wrench import required_wrench, wrench_matrix
from cabslice.timing.grid import Grid
from cabslice.timing.path import Path
from cabslice.toolpath.path import Toolpath

RESERVE = 0.03          # share of every dynamic range kept back for what happens between two nodes
LEAST_ROOM = 0.25       # share of a motor's speed that taking up stretch may use even where the nozzle may be very fast
SHORTEST_RAMP = 1e-3    # s in which acceleration is taken to ramp where it is not averaged
NO_SPEED_LIMIT = 1e12   # mm^2/s^2


@dataclass(frozen=True)
class Limits:
    """Everything but the cables that bounds the motion; absent bounds are inf."""

    acceleration: float          # mm/s^2 per axis
    speed: float                 # mm/s
    flow: float                  # mm^3/s
    feed_speed: float            # mm/s of filament
    feed_acceleration: float     # mm/s^2 of filament
    feed_jump: float             # mm/s of filament
    window: float                # s over which the motion is averaged; 0: acceleration may step
    advance: float = 0.0         # s of pressure advance

    @property
    def gain(self) -> float:
        """Acceleration of the extruder over that of the filament laid."""
        return 1 + 2 * self.advance / self.window if self.advance else 1.0

    @property
    def laying_speed(self) -> float:
        """mm/s of filament laid in moves of the nozzle."""
        if not self.advance:
            return self.feed_speed
        return self.feed_speed - self.advance * (self.feed_acceleration / self.gain + self.feed_jump / self.window)


def limits_of(printer: Any, material: Any) -> Limits:
    """Limits from the profiles (cabslice.profile.printer.Printer, .material.Material).

    Raises ImpossibleError where pressure advance leaves the extruder no speed.
    """
    motion, extruder = printer.motion, printer.extruder
    advance, window = extruder.pressure_advance_s, motion.smoothing_ms * 1e-3
    limits = Limits(
        acceleration=motion.max_acceleration_mm_s2 or np.inf,
        speed=motion.max_speed_mm_s,
        flow=min(extruder.max_flow_mm3_s, material.max_flow_mm3_s),
        feed_speed=extruder.max_speed_mm_s,
        feed_acceleration=extruder.max_acceleration_mm_s2,
        feed_jump=extruder.max_jump_mm_s / (1 + advance / window if advance else 1.0),
        window=window,
        advance=advance,
    )
    if not limits.laying_speed > 0:
        raise ImpossibleError(
            f"pressure advance of {advance:g} s asks the extruder for more than its {limits.feed_speed:g} mm/s at any "
            "speed: lower extruder.pressure_advance_s, extruder.max_acceleration_mm_s2 or extruder.max_jump_mm_s, or "
            "raise extruder.max_speed_mm_s or motion.smoothing_ms")
    return limits


Block = tuple[Array, Array, Array, Array]     # a, b, lo, hi, each (R, K)


@dataclass(frozen=True)
class Nodes:
    """K places on the path: level poses (K, 6), q' and q'' padded with zero rotation (K, 6), filament per mm (K,) as
    the extruder sees it accelerate, largest acceleration per axis (K,) mm/s^2, inf where only the cables limit it.
    Where the platform turns, rotations too (angular velocity and its rate by s), and q' and q'' (K, 3) of the nozzle by
    themselves."""

    poses: Array
    d1: Array
    d2: Array
    feed: Array
    acceleration: Array
    nozzle: tuple[Array, Array] | None = None


def rows(robot: Robot, limits: Limits, nodes: Nodes) -> tuple[Array, Array, Array]:
    """Rows a u + b x <= 1, a and b (K, R), and the margin (K,) at rest: <= 0 where the platform cannot even rest."""
    holding = tension(robot, nodes)
    margin = np.minimum(holding[3], -holding[2]).min(axis=0)
    return *scaled([holding, winding(robot, nodes), axes(nodes), feeding(limits, nodes)]), margin


def scaled(blocks: Sequence[Block]) -> tuple[Array, Array]:
    """a and b (K, R) of rows a u + b x <= 1, the reserve kept back: what every machine hands to the recursion."""
    a = np.concatenate([side for block in blocks for side in _one_sided(block[0], block)])
    b = np.concatenate([side for block in blocks for side in _one_sided(block[1], block)])
    return np.ascontiguousarray(a.T), np.ascontiguousarray(b.T)


def _one_sided(values: Array, block: Block) -> tuple[Array, Array]:
    _, _, low, high = block
    with np.errstate(divide="ignore", invalid="ignore"):     # where rest is impossible the caller refuses
        return values / (high * (1 - RESERVE)), values / (low * (1 - RESERVE))


def tension(robot: Robot, nodes: Nodes) -> Block:
    """A tension within bounds exists: exact (domain of the wrench, projected on u and x)."""
    free = robot.freedoms
    base = required_wrench(robot, nodes.poses)
    along_u = required_wrench(robot, nodes.poses, np.zeros_like(nodes.d1), nodes.d1) - base
    along_x = required_wrench(robot, nodes.poses, nodes.d1, nodes.d2) - base
    return tension_rows(
        wrench_matrix(robot, nodes.poses)[:, free], base[:, free], along_u[:, free], along_x[:, free],
        robot.tension_min, usable_tension_max(robot))


def take_up_cap(robot: Machine, limits: Limits, xyz: Array) -> float:
    """mm/s^2 per axis: averaged over the window, accelerations up to it stretch the cables no faster than the motors
    take up beside the greatest nozzle speed. xyz (K, 3) places of the nozzle."""
    if isinstance(robot, Delta) or robot.winders is None or not len(xyz):
        return np.inf
    fastest = winding_caps(robot)[1]
    room = np.maximum(fastest - limits.speed, LEAST_ROOM * fastest)
    swing = take_up(robot, nozzle_poses(robot, xyz)).max(axis=0)
    return float((room / swing).min() * max(limits.window, SHORTEST_RAMP) / 2)


def winding_caps(robot: Robot) -> tuple[Array, Array]:
    """(m,) mm/s^2 of cable that the torque kept for winding gives, and (m,) mm/s of cable that the winders reach."""
    winders = robot.winders
    if winders is None:
        return np.full(robot.cables, np.inf), np.full(robot.cables, np.inf)
    least = transmission_bounds(winders)[0]                          # mm of cable per rad
    with np.errstate(divide="ignore"):
        spin = TORQUE_SHARE * winders.continuous_torque / (winders.inertia * NEWTON)
    return spin * least, winders.max_speed * least * (1 - RESERVE)


def winding(robot: Robot, nodes: Nodes) -> Block:
    """|cable acceleration| stays within what the torque kept for turning the winders gives."""
    still = np.zeros_like(nodes.d1)
    first = length_accelerations(robot, nodes.poses, still, nodes.d1).T
    second = length_accelerations(robot, nodes.poses, nodes.d1, nodes.d2).T
    high = np.broadcast_to(winding_caps(robot)[0][:, None], first.shape)
    return first, second, -high, high


def axes(nodes: Nodes) -> Block:
    d1, d2 = nodes.nozzle or (nodes.d1[:, :3], nodes.d2[:, :3])
    a, b = d1.T, d2.T
    high = np.broadcast_to(nodes.acceleration, a.shape)
    return a, b, -high, high


def feeding(limits: Limits, nodes: Nodes) -> Block:
    a = nodes.feed[None]
    high = np.full(a.shape, limits.feed_acceleration)
    return a, np.zeros_like(a), -high, high


def speed_limit(toolpath: Toolpath, path: Path, limits: Limits) -> Array:
    """(N,) mm/s, largest ds/dt in each move: asked speed, machine, melt flow, filament drive.

    In an extrude-only move s is filament, so only the filament's own limits hold.
    """
    travel = path.direction.any(axis=1)
    feed = np.abs(path.feed)
    melting = travel & (feed > 0)
    by_flow = np.where(melting, limits.flow / np.maximum(feed * toolpath.filament_area_mm2, 1e-12), np.inf)
    fastest = np.where(travel, limits.laying_speed, limits.feed_speed)
    by_drive = np.where(feed > 0, fastest / np.maximum(feed, 1e-12), np.inf)
    return np.minimum.reduce([_asked(toolpath, path), np.where(travel, limits.speed, np.inf), by_flow, by_drive])


def _asked(toolpath: Toolpath, path: Path) -> Array:
    """(N,) mm/s asked for in each move, the vertices left out on its way included."""
    asked = toolpath.speed
    for row in np.flatnonzero((path.length == 0) & (toolpath.lengths > 0)).tolist():
        carrier = path.carrier[row]
        asked = asked.copy() if asked is toolpath.speed else asked
        asked[carrier] = min(asked[carrier], asked[row])
    return asked


def highest_x(grid: Grid, path: Path, limits: Limits, speed: Array) -> tuple[Array, Array]:
    """Largest x at the start and at the end of every interval, (I,) each, from speed (N,) and filament steps."""
    top = speed[grid.move] ** 2
    last = np.flatnonzero(grid.high >= path.length[grid.move])
    move, at_end = grid.move[last], top.copy()
    jump = np.abs(path.feed[path.after[move]] - path.feed[move])
    through = np.where(jump > 0, (limits.feed_jump / np.maximum(jump, 1e-12)) ** 2, NO_SPEED_LIMIT)
    at_end[last] = np.minimum(top[last], through)
    return top, at_end


def winder_speed_x(robot: Robot, nodes: Nodes) -> Array:
    """(K,) mm^2/s^2, largest x that keeps every winder within its speed on its innermost layer."""
    per_s = np.abs(length_accelerations(robot, nodes.poses, np.zeros_like(nodes.d1), nodes.d1))
    fastest = (per_s / winding_caps(robot)[1]).max(axis=1)
    return 1 / np.maximum(fastest, NO_SPEED_LIMIT**-0.5) ** 2
