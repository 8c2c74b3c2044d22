"""simulate --circle --png: the circle both ways, as a ballbar shows it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from cabslice.cli.asked import Asked

if TYPE_CHECKING:
    from cabslice.arrays import Array
    from cabslice.cli.simulate import Circle, Drawn


def both_ways(asked: Asked, circle: Circle, damping: str | float, drawn: Drawn) -> dict[str, Any]:
    """Draw it, and circularities in mm: counter-clockwise, clockwise, at rest on every pose, and between both ways."""
    import numpy as np

    from cabslice.view import charts

    assert drawn.png is not None
    assert circle.circle is not None
    ways = {"counter-clockwise": _gone(asked, replace(circle, backwards=False), damping),
            "clockwise": _gone(asked, replace(circle, backwards=True), damping)}
    lines = {name: way[0] for name, way in ways.items()} | {"at rest": ways["counter-clockwise"][1]}
    charts.save(charts.ballbar(lines, circle.circle, title=asked.robot().name), drawn.png, overwrite=drawn.overwrite)
    around = np.linspace(-np.pi, np.pi, 721)
    radii = [np.interp(around, angle[np.argsort(angle)], radius[np.argsort(angle)], period=2 * np.pi)
             for angle, radius in (way[0] for way in ways.values())]
    return {"circularity_mm": {name: float(np.ptp(radius)) for name, (_, radius) in lines.items()},
            "largest_between_both_ways_mm": float(np.abs(radii[0] - radii[1]).max())}


def _gone(asked: Asked, circle: Circle, damping: str | float) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Angle (K,) rad and radius (K,) mm about the centre, moving, and standing still on every pose."""
    import numpy as np

    from cabslice.cli.simulate import damped
    from cabslice.simulation.motion import commanded, tensions
    from cabslice.simulation.plant import at_rest, play
    from cabslice.simulation.statics import equilibrium

    robot, profile = asked.robot(), asked.profile()
    motion = circle.motion(profile.stream.period_ms * 1e-3)
    planned = tensions(robot, motion, circle.distribution)
    command = commanded(robot, motion, planned)
    plant = damped(robot, profile, damping, motion.poses[0], planned[0], command.rows[0, 1])
    moved = play(plant, command, at_rest(robot, motion.poses[0])).poses
    still = equilibrium(robot, command.rows[:, 0], command.rows[:, 1], motion.poses)[0]

    def polar(poses: Array) -> tuple[Array, Array]:
        off = poses[:, :2] - circle.centre
        return np.arctan2(off[:, 1], off[:, 0]), np.hypot(off[:, 0], off[:, 1])

    return polar(moved), polar(still)
