"""Hangprinters of RepRapFirmware: from config.g to a printer profile (the way back is in `reprap_lines`).

Legend (RepRapFirmware, HangprinterKinematics; Ludvigsen's config.g of Hangprinter v4)
    M669 K6    "this is a Hangprinter"; N number of anchors (absent: 4); A B C D, then I J K L O: anchors x:y:z, mm,
               from the point where the lines end, with the machine at the origin (D may be its height alone)
    M666       Q build-up factor, mm          R spool radii at the origin, mm     U mechanical advantages
               O lines per spool              L, H teeth of motor and spool       W mass of the mover, kg
               S N per unit strain            I, X least and largest force, N     T wanted force, N
               Y lines from spool to anchor, mm (< 0: all spools stand at the last anchor)
    M208       limits of x, y, z: maxima, minima with S1, or least:largest
    M201, M203, M566   accelerations mm/s^2, speeds and speed steps mm/min

Older firmware takes the letters of M666 behind M669. The firmware's coordinates are those of the point where the lines
end, with z = 0 when the nozzle touches the bed; so they are the nozzle's over the bed.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cabslice.profile.imported import ASSUMED, Builder, Imported, name_from, text_of

ANCHORS = "ABCDIJKLO"
EARLIER = "QRUOLHJWIXY"                    # of M666, behind M669 in older firmware
READ = ("M201", "M203", "M208", "M550", "M566", "M666", "M669")
DROP = 130.0                               # mm from the end of the lines down to the nozzle
_WORD = re.compile(r'([A-Za-z])\s*("[^"]*"|\{[^}]*\}|[-+0-9.:]*)')


@dataclass
class Words:
    """The last word of each letter behind one code, and the line it stands in."""

    found: dict[str, tuple[str, int]] = field(default_factory=dict)

    def text(self, letter: str) -> str:
        return self.found[letter][0]

    def where(self, letter: str) -> str:
        return f"line {self.found[letter][1]}"


def read_config(path: Path, name: str | None = None) -> Imported:
    """The Hangprinter of a config.g. Raises ProfileError with every fault: line, what was expected."""
    codes = _codes(text_of(path))
    builder = Builder(str(path))
    count = _count(builder, codes["M669"])
    builder.stop()
    builder.values["cable"] = [{} for _ in range(count)]
    _spare(codes, count)
    _lines(builder, codes["M669"], count)
    _spools(builder, codes["M666"], count)
    _forces(builder, codes["M666"], count)
    builder.stop()
    _machine(builder, codes)
    builder.left_out += _unused(codes)
    called = codes["M550"].found.get("P", ("", 0))[0].strip('"')
    source = f"{path.name}, M669 and M666 of RepRapFirmware"
    return builder.finish(name or name_from(called or path.stem), f"Hangprinter of {path.name}", source)


def _codes(text: str) -> dict[str, Words]:
    """The words of the codes that are read; a later line replaces letters of an earlier one."""
    codes = {code: Words() for code in (*READ, "M208 S1")}
    for number, line in enumerate(text.splitlines(), 1):
        plain = re.sub(r";.*", "", line)
        start = re.match(r"\s*(?:N\d+\s+)?([GMT])\s*0*(\d+)(?![\d.])", plain, re.IGNORECASE)
        code = f"{start[1].upper()}{start[2]}" if start else ""
        if not start or code not in codes:
            continue
        words = {found[1].upper(): (found[2], number) for found in _WORD.finditer(plain, start.end())}
        minima = code == "M208" and words.pop("S", ("0", 0))[0] == "1"
        codes["M208 S1" if minima else code].found.update(words)
    return codes


def _count(builder: Builder, words: Words) -> int:
    """How many anchors; a fault where this is no Hangprinter."""
    if "K" not in words.found:
        builder.fault("", "there is no M669 K6; expected the config.g of a Hangprinter")
    elif words.text("K") != "6":
        builder.fault(words.where("K"), f"M669 K{words.text('K')} is no Hangprinter, expected K6")
    if "N" not in words.found:
        return 4
    (count,) = _numbers(builder, "M669", words, "N", 1)
    if not builder.faults and count not in range(3, len(ANCHORS) + 1):
        builder.fault(words.where("N"), f"M669 N: expected 3 to {len(ANCHORS)} anchors, found {words.text('N')}")
    return int(count) if math.isfinite(count) else 4


def _spare(codes: dict[str, Words], count: int) -> None:
    """Letters of M666 that older firmware has behind M669, to where they belong now."""
    for letter in EARLIER:
        if letter in codes["M669"].found and letter not in ANCHORS[:count]:
            codes["M666"].found.setdefault(letter, codes["M669"].found.pop(letter))


def _numbers(builder: Builder, code: str, words: Words, letter: str, count: int) -> list[float]:
    """The numbers of a word; nan and a fault where there are not `count` of them."""
    parts = words.text(letter).split(":")
    try:
        values = [float(part) + 0.0 for part in parts]      # -0 is 0
        if len(values) == count:
            return values
        wanted = "a number" if count == 1 else f"{count} numbers"
        found = f"found {len(values)}"
    except ValueError:
        wanted, found = "numbers" if count > 1 else "a number", f"found {words.text(letter) or 'nothing'}"
    builder.fault(words.where(letter), f"{code} {letter}: expected {wanted}, {found}")
    return [math.nan] * count


def _lines(builder: Builder, words: Words, count: int) -> None:
    builder.values["freedoms"] = ["x", "y", "z"]
    for index, letter in enumerate(ANCHORS[:count]):
        if letter not in words.found:
            builder.fault("", f"M669 {letter}: missing, expected the place x:y:z of an anchor")
            continue
        if letter == "D" and ":" not in words.text(letter):
            anchor = [0.0, 0.0, *_numbers(builder, "M669", words, letter, 1)]
        else:
            anchor = _numbers(builder, "M669", words, letter, 3)
        builder.read(("cable", index, "anchor_mm"), anchor, f"{letter}, {words.where(letter)}")
        builder.values["cable"][index]["attachment_mm"] = [0.0, 0.0, 0.0]


def _spools(builder: Builder, words: Words, count: int) -> None:
    for letter, what in (("Q", "the build-up factor of the spools"), ("R", "the radii of the spools")):
        if letter not in words.found:
            builder.fault("", f"M666 {letter}: missing, expected {what}")
    for index in range(count):
        builder.values["cable"][index]["winder"] = {"kind": "spool"}
    if "Q" in words.found:
        (factor,) = _numbers(builder, "M666", words, "Q", 1)
        builder.read(("cables", "winder", "buildup_factor_mm"), factor, f"Q, {words.where('Q')}")
    if "R" in words.found:
        _each(builder, words, "R", ("winder", "first_radius_mm"), count)
    usual = [2] * (count - 1) + [4]
    for letter, key, default in (("U", "mechanical_advantage", usual), ("O", "lines_per_spool", [1] * count)):
        if letter in words.found:
            _each(builder, words, letter, ("winder", key), count, whole=True)
        else:
            for index, value in enumerate(default):
                builder.read(("cable", index, "winder", key), value, ASSUMED)
            builder.assumed.append(f"cables.winder.{key}: M666 {letter} is not given; as Hangprinter v4")
    _gears(builder, words, count)
    builder.read(("cables", "winder", "home_angle_deg"), 0.0, "at the origin")


def _gears(builder: Builder, words: Words, count: int) -> None:
    teeth = {}
    for letter, usual in (("H", 255.0), ("L", 20.0)):
        given = letter in words.found
        teeth[letter] = _numbers(builder, "M666", words, letter, count) if given else [usual] * count
        if given and any(one <= 0 for one in teeth[letter]):
            builder.fault(words.where(letter), f"M666 {letter}: expected teeth above 0, found {words.text(letter)}")
            return
    lacking = [letter for letter in "HL" if letter not in words.found]
    note = ASSUMED if lacking else f"H/L, {words.where('H')}"
    for index, (spool, motor) in enumerate(zip(teeth["H"], teeth["L"], strict=True)):
        builder.read(("cable", index, "winder", "gear_ratio"), spool / motor, note)
    if lacking:
        builder.assumed.append(f"cables.winder.gear_ratio: M666 {' and '.join(lacking)} not given; 255 teeth over 20")


def _each(
    builder: Builder, words: Words, letter: str, key: tuple[str, ...], count: int, *, whole: bool = False
) -> None:
    """One value for each cable."""
    values = _numbers(builder, "M666", words, letter, count)
    if whole and any(value != round(value) for value in values if math.isfinite(value)):
        builder.fault(words.where(letter), f"M666 {letter}: expected whole numbers, found {words.text(letter)}")
        return
    for index, value in enumerate(values):
        made: Any = int(value) if whole and math.isfinite(value) else value
        builder.read(("cable", index, *key), made, f"{letter}, {words.where(letter)}")


def _forces(builder: Builder, words: Words, count: int) -> None:
    """Mass, stiffness, bounds of the tension, lines to the spools."""
    mass = _one(builder, words, "W", 0.0)
    if mass == 0:
        builder.assume({("platform", "mass_kg"): 2.0}, "M666 W does not say; as Hangprinter v4")
    else:
        builder.read(("platform", "mass_kg"), mass, f"W, {words.where('W')}")
    if "S" in words.found:
        builder.read(("cables", "axial_stiffness_n"), _one(builder, words, "S", 0.0), f"S, {words.where('S')}")
    else:
        builder.assume({("cables", "axial_stiffness_n"): 20000.0}, "M666 S is not given; as Hangprinter v4")
    for letter, key, usual in (("I", "min_tension_n", 1.0), ("X", "max_tension_n", 120.0)):
        if letter in words.found:
            _each(builder, words, letter, (key,), count)
        else:
            builder.assume({("cables", key): usual}, f"M666 {letter} is not given")
    if "T" in words.found:
        builder.read(("cables", "reference_tension_n"), _one(builder, words, "T", 0.0), f"T, {words.where('T')}")
    else:
        for index, cable in enumerate(builder.values["cable"]):
            level = min(max(20.0, cable["min_tension_n"]), cable["max_tension_n"])
            builder.read(("cable", index, "reference_tension_n"), level, ASSUMED)
        builder.assumed.append("cables.reference_tension_n: M666 T is not given; 20 N, within the bounds")
    _guys(builder, words, count)


def _one(builder: Builder, words: Words, letter: str, default: float) -> float:
    return _numbers(builder, "M666", words, letter, 1)[0] if letter in words.found else default


def _guys(builder: Builder, words: Words, count: int) -> None:
    given = _numbers(builder, "M666", words, "Y", count) if "Y" in words.found else [-1.0] * count
    if all(not length < 0 for length in given):
        _each(builder, words, "Y", ("winder", "line_mm"), count)
        return
    anchors = [cable.get("anchor_mm") for cable in builder.values["cable"]]
    for index, anchor in enumerate(anchors):
        length = round(math.dist(anchor, anchors[-1]), 3) if anchor and anchors[-1] else 0.0
        builder.read(("cable", index, "winder", "line_mm"), length, ASSUMED)
    builder.assumed.append("cables.winder.line_mm: all spools stand at the last anchor, as the firmware takes it")


# ---- what is no business of M669 and M666

def _machine(builder: Builder, codes: dict[str, Words]) -> None:
    cables = builder.values["cable"]
    builder.assume({("platform", "inertia_kg_mm2"): [10000.0] * 3}, "it is not felt, the platform does not turn")
    builder.assume({("nozzle", "diameter_mm"): 0.8}, "0.8 mm")
    builder.assume({("nozzle", "offset_mm"): [0.0, 0.0, -DROP], ("bed", "z_mm"): -DROP},
                   "below the point where the lines end, by as much as on Hangprinter v4")
    _bed(builder, codes)
    _motion(builder, codes)
    builder.assume({("cables", "diameter_mm"): 1.1, ("cables", "clearance_mm"): 2.0}, "fishing line of 1.1 mm")
    for index, cable in enumerate(cables):
        builder.read(("cable", index, "winder", "angle_range_deg"), _range(cable), ASSUMED)
    builder.assumed.append("cables.winder.angle_range_deg: the line there is at the origin, in and out once more")
    motor = {"max_speed_rad_s": 400.0, "continuous_torque_n_m": 1.0, "peak_torque_n_m": 2.0, "inertia_kg_mm2": 100.0}
    builder.assume({("cables", "motor", key): value for key, value in motor.items()},
                   "a brushless motor of about 500 W")


def _range(cable: dict[str, Any]) -> list[float]:
    """Motor angles, deg: in and out by a fifth more than the line at the origin, while a radius is left."""
    winder, radius = cable["winder"], cable["winder"]["first_radius_mm"]
    gear = winder["gear_ratio"]
    most = 1.2 * winder["mechanical_advantage"] * math.hypot(*cable["anchor_mm"]) / radius
    slope = winder["buildup_factor_mm"] * winder["lines_per_spool"] / 2
    least = min(most, 0.9 * radius / slope) if slope > 0 else most
    return [-math.ceil(math.degrees(least * gear)) * 1.0, math.ceil(math.degrees(most * gear)) * 1.0]


def _bed(builder: Builder, codes: dict[str, Words]) -> None:
    least, most = codes["M208 S1"], codes["M208"]
    limits = [_limits(builder, least, most, letter) for letter in "XY"]
    if all(limits):
        where = f"M208, {most.where('X')}"
        ends = [limit or (0.0, 0.0) for limit in limits]
        if any(high <= low for low, high in ends):
            builder.fault(where, "expected limits that rise")
        builder.read(("bed", "size_mm"), [high - low for low, high in ends], where)
        builder.read(("bed", "centre_mm"), [(high + low) / 2 for low, high in ends], where)
        return
    lower = [math.hypot(*cable["anchor_mm"][:2]) for cable in builder.values["cable"] if cable["anchor_mm"][2] <= 0]
    side = math.floor(min(lower, default=1000.0) / 200) * 100.0 or 100.0
    builder.assume({("bed", "size_mm"): [side, side]}, "M208 does not limit x and y; half the way to the lower anchors")


def _limits(builder: Builder, least: Words, most: Words, letter: str) -> tuple[float, float] | None:
    if letter in most.found and ":" in most.text(letter):
        low, high = _numbers(builder, "M208", most, letter, 2)
        return low, high
    if letter in most.found and letter in least.found:
        return _numbers(builder, "M208 S1", least, letter, 1)[0], _numbers(builder, "M208", most, letter, 1)[0]
    return None


def _motion(builder: Builder, codes: dict[str, Words]) -> None:
    for place, code, wanted, scale, usual in (
        (("motion", "max_speed_mm_s"), "M203", "XYZ", 60.0, 200.0),
        (("motion", "max_acceleration_mm_s2"), "M201", "XYZ", 1.0, 1000.0),
        (("extruder", "max_speed_mm_s"), "M203", "E", 60.0, 30.0),
        (("extruder", "max_acceleration_mm_s2"), "M201", "E", 1.0, 1000.0),
        (("extruder", "max_jump_mm_s"), "M566", "E", 60.0, 5.0),
    ):
        words, letters = codes[code], [letter for letter in wanted if letter in codes[code].found]
        given = [_numbers(builder, code, words, letter, words.text(letter).count(":") + 1)[0] for letter in letters]
        if given:
            builder.read(place, min(given) / scale, f"{code}, {words.where(letters[0])}")
        else:
            builder.assume({place: usual}, f"{code} {' '.join(wanted)} is not given")
    builder.assume({("extruder", "max_flow_mm3_s"): 20.0}, "20 mm^3/s")
    builder.assume({("defaults", "material"): "pla", ("defaults", "process"): "standard-0.8"}, "for a nozzle of 0.8 mm")


def _unused(codes: dict[str, Words]) -> list[str]:
    """What M669 and M666 say that a profile has no place for."""
    words = {"J": "full steps per turn of the motors", "C": "torque constants", "A": "the mode of the anchors",
             "F": "the way flex is compensated", "B": "whether gravity counts", "P": "whether pretension counts"}
    told = [f"M666 {letter} ({codes['M666'].where(letter)}): {what} are not part of a profile"
            for letter, what in words.items() if letter in codes["M666"].found]
    return told + [f"M669 {letter} ({codes['M669'].where(letter)}): not part of a profile"
                   for letter in "PST" if letter in codes["M669"].found]
