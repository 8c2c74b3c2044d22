"""Klipper with the motors as extra axes (MANUAL_STEPPER GCODE_AXIS). See motor_gcode.

F is mm/min of the axis that goes furthest, for such is the length of a move in which x, y and z stand still.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.motors.formats import motor_gcode, table
from cabslice.motors.formats.motor_gcode import Dialect

LETTERS = "ABCDHIJKLUVW"


def feed(steps: Array, seconds: Array) -> Array:
    return 60 * np.abs(steps).max(axis=1) / seconds


def seconds(steps: Array, feed: Array) -> Array:
    return 60 * np.abs(steps).max(axis=1) / feed


def begin(header: Mapping[str, Any]) -> list[str]:
    """Lines for printer.cfg as comments, then what makes axes of the motors and says where they stand."""
    told = motor_gcode.limits(header)
    lines = ["[printer]", "kinematics: none", "max_velocity: 1", "max_accel: 1", *_steppers(told)]
    lines += ["[extruder] # as usual; the instantaneous_corner_velocity as high as max_jump_mm_s of the profile"]
    starts = np.array(header["start_angles_rad"]) * motor_gcode.DEGREES
    axes = [
        f"MANUAL_STEPPER STEPPER=winder_{i + 1} SET_POSITION={starts[i]:.4f} ENABLE=1\n"
        f"MANUAL_STEPPER STEPPER=winder_{i + 1} GCODE_AXIS={LETTERS[i]} LIMIT_VELOCITY={row['speed']:.3f} "
        f"LIMIT_ACCEL=1000000 INSTANTANEOUS_CORNER_VELOCITY={row['speed']:.3f}"
        for i, row in enumerate(told)
    ]
    return [*(f"; {line}" for line in lines), *axes, "G90", "M82", "G92 E0"]


def _steppers(told: list[dict[str, Any]]) -> Iterator[str]:
    for i, row in enumerate(told):
        yield f"[manual_stepper winder_{i + 1}] # with step_pin, dir_pin, enable_pin as wired"
        yield "rotation_distance: 360 # 1 mm of the axis is 1 degree of the motor"
        steps = "of your drive" if row["steps"] is None else f"{round(row['steps'] * 360)}"
        yield f"full_steps_per_rotation: {steps}"
        yield "microsteps: 1"
        yield from (f"position_{name}: {row[key]:.3f}" for name, key in (("min", "low"), ("max", "high"))
                    if row[key] is not None)


DIALECT = Dialect("klipper", b"; cabslice motor angles for Klipper\n", LETTERS, feed, seconds, begin, b"; G92 ",
                  b"", "PAUSE")
TABLE = motor_gcode.table_of(DIALECT)
refuse = partial(motor_gcode.refuse, DIALECT)
write = partial(table.write, TABLE)
read = partial(table.read, TABLE)
