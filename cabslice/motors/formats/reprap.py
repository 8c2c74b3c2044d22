"""RepRapFirmware 3.5 and later, in inverse time mode (G93: F is 1 over the minutes a move takes). See motor_gcode."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from cabslice.arrays import Array
from cabslice.motors.formats import motor_gcode, table
from cabslice.motors.formats.motor_gcode import Dialect

LETTERS = "XYZUVWABCD"


def feed(steps: Array, seconds: Array) -> Array:
    return 60 / seconds


def seconds(steps: Array, feed: Array) -> Array:
    return 60 / feed


def begin(header: Mapping[str, Any]) -> list[str]:
    """Lines for config.g as comments, then the modes of the file."""
    told = motor_gcode.limits(header)
    axes = LETTERS[: len(told)]

    def words(key: str, form: str, scale: float = 1.0) -> str:
        return " ".join(f"{axis}{row[key] * scale:{form}}" for axis, row in zip(axes, told, strict=True))

    known = all(row["steps"] for row in told)
    lines = [
        "M669 K0 ; no kinematics of its own: an axis is a motor, 1 mm is 1 degree of it",
        f"M584 {' '.join(f'{axis}{i}' for i, axis in enumerate(axes))} S0 E{len(axes)} ; drives as wired, all linear",
        f"M92 {words('steps', '.6f')} ; steps per degree" if known else "M92 ... ; steps per degree of your drives",
        f"M203 {words('speed', '.3f', 60)} ; degrees per minute: what the motors may do",
        f"M566 {words('speed', '.3f', 60)} P1 ; any step between pieces: the plan has limited them",
        f"M201 {' '.join(f'{axis}1000000' for axis in axes)} ; likewise",
        "M564 S0 H0 ; the motors are not homed but set: G92 below says where they stand",
    ]
    for key, mode in (("low", 1), ("high", 0)):
        if all(row[key] is not None for row in told):
            lines.append(f"M208 {words(key, '.3f')} S{mode} ; what the winders hold")
    return [*(f"; {line}" for line in lines), "G90", "M82", "G93"]


DIALECT = Dialect("reprap", b"; cabslice motor angles for RepRapFirmware\n", LETTERS, feed, seconds, begin, b"G92 ",
                  b"G94\n", "M226")
TABLE = motor_gcode.table_of(DIALECT)
refuse = partial(motor_gcode.refuse, DIALECT)
write = partial(table.write, TABLE)
read = partial(table.read, TABLE)
