"""What firmwares call things: Marlin, Klipper, RepRapFirmware.

No flavour releases the motors at the end (M84): the platform of a cable robot would fall.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from cabslice.toolpath.path import EventKind


def plain(number: float, places: int = 4) -> str:
    """A number without useless zeros."""
    return f"{number:.{places}f}".rstrip("0").rstrip(".")


@dataclass(frozen=True)
class Flavor:
    """Words of a firmware: pause, fan at a share 0..1, pressure advance in s, the object that is printed next."""

    name: str
    pause: str
    fan: Callable[[float], str]
    advance: Callable[[float], str]
    object: Callable[[int], str]


def _fan_of_255(share: float) -> str:
    return f"M106 S{plain(255 * share)}" if share else "M107"


FLAVORS = {flavor.name: flavor for flavor in (
    Flavor("marlin", "M601 ; pause", _fan_of_255, lambda k: f"M900 K{plain(k)}", lambda number: f"M486 S{number}"),
    Flavor(
        "klipper", "PAUSE", _fan_of_255, lambda k: f"SET_PRESSURE_ADVANCE ADVANCE={plain(k)}",
        lambda number: f"EXCLUDE_OBJECT_START NAME=object_{number}",
    ),
    Flavor(
        "reprapfirmware", "M226 ; pause", lambda share: f"M106 P0 S{plain(share)}", lambda k: f"M572 D0 S{plain(k)}",
        lambda number: f"M486 S{number}",
    ),
)}
WAIT = {EventKind.NOZZLE_TEMPERATURE: "M109", EventKind.BED_TEMPERATURE: "M190"}
HEAT = {EventKind.NOZZLE_TEMPERATURE: "M104", EventKind.BED_TEMPERATURE: "M140"}


def event_line(flavor: Flavor, kind: int, value: float, *, wait: bool) -> str:
    """The line of an event; temperatures are waited for with `wait`."""
    if kind in HEAT:
        return f"{(WAIT if wait else HEAT)[EventKind(kind)]} S{plain(value)}"
    return {
        EventKind.FAN: lambda: flavor.fan(value), EventKind.DWELL: lambda: f"G4 S{plain(value)}",
        EventKind.PAUSE: lambda: flavor.pause, EventKind.FILAMENT_CHANGE: lambda: "M600 ; change the filament",
        EventKind.MIN_LAYER_TIME: lambda: f";MIN_LAYER_TIME:{plain(value)}",
        EventKind.MIN_PRINT_SPEED: lambda: f";MIN_PRINT_SPEED:{plain(value)}",
    }[EventKind(kind)]()


def object_names(flavor: Flavor, count: int) -> Iterator[str]:
    """What is told of several objects at the head of the file."""
    if flavor.name == "klipper":
        for number in range(count):
            yield f"EXCLUDE_OBJECT_DEFINE NAME=object_{number}"
    else:
        yield f"M486 T{count}"


def ending(flavor: Flavor) -> Iterator[str]:
    yield flavor.fan(0.0)
    yield "M104 S0 ; heating off"
    yield "M140 S0"
