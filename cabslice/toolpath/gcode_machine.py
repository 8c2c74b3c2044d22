"""A machine that obeys G-code and writes down where its nozzle went.

Positions are mm in the coordinates of the file before any shift by G92. Rows are kept in flat arrays: five numbers a
row (x, y, z, filament, speed mm/s), the number of the tag (role, layer, width, ...) valid then, and the line.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import acos, atan2, ceil, cos, hypot, pi, sin, sqrt
from typing import Any

from cabslice.slicing.layer import Role
from cabslice.toolpath.gcode_words import IGNORED, PAUSES, ROLE_OF, SPEECHLESS, parse
from cabslice.toolpath.path import EventKind

CHORD_MM = 0.005   # how far a chord may lie from its arc
INCH_MM = 25.4
AXES = "XYZ"
TOLD = ("filament_diameter", "nozzle_diameter")   # settings that OrcaSlicer's header tells as "name: value"


@dataclass(frozen=True)
class Tag:
    role: int = Role.CUSTOM
    layer: int = 0
    width: float = 0.0    # mm, 0 where the file does not say
    height: float = 0.0
    object: int = 0


@dataclass
class Machine:
    """Call `obey` line by line. Raises ValueError with a sentence for what cannot be read."""

    at: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    shift: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])   # position = word + shift
    fed: float = 0.0                       # the E of the last move
    speed: float = 0.0                     # mm/s
    unit: float = 1.0                      # mm
    absolute: bool = True
    absolute_feed: bool = True
    flow: float = 1.0
    haste: float = 1.0
    rows: array[float] = field(default_factory=lambda: array("d"))
    tag_of: array[int] = field(default_factory=lambda: array("i"))
    line_of: array[int] = field(default_factory=lambda: array("i"))
    tags: list[Tag] = field(default_factory=lambda: [Tag()])
    events: list[tuple[int, int, float]] = field(default_factory=list)
    breaks: list[int] = field(default_factory=list)                       # rows before which the nozzle rests
    settings: dict[str, str] = field(default_factory=dict)
    objects: dict[str, int] = field(default_factory=dict)
    unread: dict[str, int] = field(default_factory=dict)                  # command -> first line
    own: bool = False
    layers: int = 0                        # layer tags seen
    typed: bool = False                    # role tags seen
    number: int = 0                        # of the line

    def obey(self, line: str) -> None:
        self.number += 1
        code, semicolon, comment = line.partition(";")
        if semicolon:
            self._comment(comment.strip(), alone=not code.strip())
        if "(" in code:
            code = code.partition("(")[0]
        code = code.strip()
        name, _, rest = code.partition(" ")
        if name in ("G1", "G0"):
            self._move(parse(rest))
        elif name:
            self._other(code.upper().partition("*")[0])

    def tell(self, **changes: Any) -> None:
        """Change the tag of the rows to come."""
        new = replace(self.tags[-1], **changes)
        if new != self.tags[-1]:
            self.tags.append(new)

    def _move(self, words: dict[str, float]) -> None:
        if "F" in words:
            self.speed = words["F"] * self.unit / 60
        target = self._target(words)
        fed = self._fed(words)
        if fed or target != self.at or (self.own and not self.rows):
            self._row(target, fed)

    def _row(self, target: list[float], fed: float) -> None:
        if not self.speed > 0:
            raise ValueError("a move before any speed; expected a word F above zero in this or an earlier move")
        self.rows.extend((*target, fed * self.flow, self.speed * self.haste))
        self.tag_of.append(len(self.tags) - 1)
        self.line_of.append(self.number)
        self.at = target

    def _target(self, words: dict[str, float]) -> list[float]:
        target = list(self.at)
        for axis, letter in enumerate(AXES):
            if letter in words:
                value = words[letter] * self.unit
                target[axis] = value + self.shift[axis] if self.absolute else target[axis] + value
        return target

    def _fed(self, words: dict[str, float]) -> float:
        """mm of filament, relative where XYZ or E are (PrusaSlicer, Klipper); remembers E."""
        if "E" not in words:
            return 0.0
        value = words["E"] * self.unit
        if not (self.absolute and self.absolute_feed):
            return value
        fed, self.fed = value - self.fed, value
        return fed

    def _other(self, code: str) -> None:
        name, rest = _split(code)
        if name in ("G0", "G1"):
            self._move(parse(rest))
        elif name in COMMANDS:
            COMMANDS[name](self, parse(rest))
        elif name == "EXCLUDE_OBJECT_START":
            self.tell(object=self._object(rest.strip().lower()))
        elif name == "M600":
            self._event(EventKind.FILAMENT_CHANGE, 0.0, rests=True)
        elif name in PAUSES:
            self._event(EventKind.PAUSE, 0.0, rests=True)
        elif name.startswith("G") and name[1:2].isdigit() and name not in IGNORED:
            raise ValueError(f"{name} is not understood; expected G0-G4, G20, G21, G28, G90-G92")
        elif name.startswith("T") and name[1:].isdigit() and name not in IGNORED:
            raise ValueError(f"{name} changes the tool; expected a file for one extruder")
        elif name not in IGNORED and name.partition(".")[0] not in SPEECHLESS:
            self.unread.setdefault(name, self.number)

    def _event(self, kind: EventKind, value: float, *, rests: bool = False) -> None:
        self.events.append((len(self.tag_of), int(kind), value))
        if rests:
            self.breaks.append(len(self.tag_of))

    def _arc(self, words: dict[str, float], turn: float) -> None:
        """A circle in XY from here to the target, turn = +1 counter-clockwise, as chords within CHORD_MM."""
        if "F" in words:
            self.speed = words["F"] * self.unit / 60
        start, target, fed = list(self.at), self._target(words), self._fed(words)
        cx, cy = _centre(start, target, {k: v * self.unit for k, v in words.items()}, turn)
        radius = hypot(start[0] - cx, start[1] - cy)
        if radius < 1e-6 or abs(hypot(target[0] - cx, target[1] - cy) - radius) > 0.01 + 0.01 * radius:
            raise ValueError("the end of the arc is not on its circle; expected I, J from the start to the centre")
        begin = atan2(start[1] - cy, start[0] - cx)
        sweep = turn * (atan2(target[1] - cy, target[0] - cx) - begin) % (2 * pi)
        if sweep < 1e-9:
            sweep = 2 * pi
        chords = max(ceil(sweep / (2 * acos(max(1 - CHORD_MM / radius, 0.5)))), 1)
        for k in range(1, chords):
            angle = begin + turn * sweep * k / chords
            z = start[2] + (target[2] - start[2]) * k / chords
            self._row([cx + radius * cos(angle), cy + radius * sin(angle), z], fed / chords)
        self._row(target, fed / chords)

    def _comment(self, text: str, alone: bool) -> None:
        key, colon, value = text.partition(":")
        if colon and alone and key.strip().upper() in TAGS:
            TAGS[key.strip().upper()](self, value.strip())
        elif colon and alone and key in TOLD:
            self.settings.setdefault(key, value.strip())
        elif alone and text in ("LAYER_CHANGE", "CHANGE_LAYER"):
            self._next_layer()
        elif alone and text.startswith("printing object "):
            self.tell(object=self.objects.setdefault(text, len(self.objects)))
        elif alone and " = " in text:
            name, _, setting = text.partition(" = ")
            self.settings[name.strip()] = setting.strip()
        elif alone and text.startswith("generated by cabslice"):
            self.own = True
        elif not alone and not self.typed and text.lower() in ROLE_OF:
            self.tell(role=ROLE_OF[text.lower()])

    def _object(self, words: str) -> int:
        """The number of an object by what a file calls it."""
        number = words.removeprefix("name=object_")
        return int(number) if self.own and number.isdecimal() else self.objects.setdefault(words, len(self.objects))

    def _next_layer(self) -> None:
        self.layers += 1
        if not self.own:
            self.tell(layer=self.layers - 1)

    def _layer_tag(self, value: str) -> None:
        if self.own:
            self.tell(layer=int(value))
        else:
            self._next_layer()

    def _type_tag(self, value: str) -> None:
        self.typed = True
        self.tell(role=ROLE_OF.get(value.lower(), Role.CUSTOM))


def _split(code: str) -> tuple[str, str]:
    """The command's name and its words; a line number N before it goes."""
    if code[:1] == "N" and code[1:2].isdigit():
        code = code.lstrip("N0123456789").strip()
    if code[:1] in "GMT" and code[1:2].isdigit():
        end = 1
        while end < len(code) and (code[end].isdigit() or code[end] == "."):
            end += 1
        number = code[1:end].lstrip("0")
        return code[0] + (number if number[:1].isdigit() else "0" + number), code[end:]
    name, _, rest = code.partition(" ")
    return name, rest


def _centre(start: list[float], end: list[float], words: dict[str, float], turn: float) -> tuple[float, float]:
    if "I" in words or "J" in words:
        return start[0] + words.get("I", 0.0), start[1] + words.get("J", 0.0)
    radius, dx, dy = words.get("R", 0.0), end[0] - start[0], end[1] - start[1]
    chord = hypot(dx, dy)
    if not (chord and abs(radius) >= chord / 2 * (1 - 1e-3)):
        raise ValueError("an arc without a circle; expected the words I and J, or R of at least half the chord")
    height = sqrt(max(radius**2 - chord**2 / 4, 0.0)) * turn * (1 if radius > 0 else -1)
    return start[0] + dx / 2 - height * dy / chord, start[1] + dy / 2 + height * dx / chord


def _home(machine: Machine, words: dict[str, float]) -> None:
    """Homing ends at 0 of the machine; what it travels is not written down."""
    for axis, letter in enumerate(AXES):
        if letter in words or not set(words) & set(AXES):
            machine.at[axis] = machine.shift[axis] = 0.0


def _set_position(machine: Machine, words: dict[str, float]) -> None:
    for axis, letter in enumerate(AXES):
        if letter in words:
            machine.shift[axis] = machine.at[axis] - words[letter] * machine.unit
    if "E" in words:
        machine.fed = words["E"] * machine.unit


def _fan(machine: Machine, words: dict[str, float]) -> None:
    """S is 0..255, or 0..1 where it is at most 1 (RepRapFirmware); other fans (P > 0) do not cool the part."""
    value = words.get("S", 255.0)
    if words.get("P", 0.0) == 0:
        machine._event(EventKind.FAN, min(value if value <= 1 else value / 255, 1.0))


def _dwell(machine: Machine, words: dict[str, float]) -> None:
    seconds = words["S"] if "S" in words else words.get("P", 0.0) / 1000
    if seconds > 0:
        machine._event(EventKind.DWELL, seconds, rests=True)


def _refuse(sentence: str) -> Callable[[Machine, dict[str, float]], None]:
    def command(machine: Machine, words: dict[str, float]) -> None:
        raise ValueError(sentence)
    return command


def _volumetric(machine: Machine, words: dict[str, float]) -> None:
    if words.get("D", 0.0) > 0:
        raise ValueError("M200 makes E a volume; expected filament length: turn volumetric E off in the slicer")


def _set(**state: float | bool) -> Callable[[Machine, dict[str, float]], None]:
    def command(machine: Machine, words: dict[str, float]) -> None:
        for name, value in state.items():
            setattr(machine, name, value)
    return command


def _heat(kind: EventKind) -> Callable[[Machine, dict[str, float]], None]:
    def command(machine: Machine, words: dict[str, float]) -> None:
        if "S" in words or "R" in words:
            machine._event(kind, words.get("S", words.get("R", 0.0)))
    return command


FIRMWARE = "firmware retraction has no length in the file; expected E moves: turn firmware retraction off in the slicer"
COMMANDS: dict[str, Callable[[Machine, dict[str, float]], None]] = {
    "G2": lambda machine, words: machine._arc(words, -1.0),
    "G3": lambda machine, words: machine._arc(words, 1.0),
    "G4": _dwell,
    "G10": _refuse(FIRMWARE), "G11": _refuse(FIRMWARE),
    "G20": _set(unit=INCH_MM), "G21": _set(unit=1.0),
    "G28": _home,
    "G90": _set(absolute=True), "G91": _set(absolute=False),
    "G92": _set_position,
    "M82": _set(absolute_feed=True), "M83": _set(absolute_feed=False),
    "M104": _heat(EventKind.NOZZLE_TEMPERATURE), "M109": _heat(EventKind.NOZZLE_TEMPERATURE),
    "M140": _heat(EventKind.BED_TEMPERATURE), "M190": _heat(EventKind.BED_TEMPERATURE),
    "M106": _fan, "M107": lambda machine, words: _fan(machine, words | {"S": 0.0}),
    "M200": _volumetric,
    "M220": lambda machine, words: setattr(machine, "haste", words.get("S", 100 * machine.haste) / 100),
    "M221": lambda machine, words: setattr(machine, "flow", words.get("S", 100 * machine.flow) / 100),
    "M486": lambda machine, words: machine.tell(object=int(words["S"])) if words.get("S", -1) >= 0 else None,
}
TAGS: dict[str, Callable[[Machine, str], None]] = {
    "TYPE": Machine._type_tag, "FEATURE": Machine._type_tag,
    "LAYER": Machine._layer_tag,
    "WIDTH": lambda machine, value: machine.tell(width=float(value)),
    "LINE_WIDTH": lambda machine, value: machine.tell(width=float(value)),
    "HEIGHT": lambda machine, value: machine.tell(height=float(value)),
    "LAYER_HEIGHT": lambda machine, value: machine.tell(height=float(value)),
    "MIN_LAYER_TIME": lambda machine, value: machine._event(EventKind.MIN_LAYER_TIME, float(value)),
    "MIN_PRINT_SPEED": lambda machine, value: machine._event(EventKind.MIN_PRINT_SPEED, float(value)),
}
