"""The words of G-code and of the comments slicers put beside them.

Tables of PrusaSlicer, OrcaSlicer (";TYPE:"), BambuStudio ("; FEATURE:"), CuraEngine (";TYPE:"), Slic3r ("; perimeter").
"""

from __future__ import annotations

import re

from cabslice.slicing.layer import Role

PRUSA_NAME = {
    Role.OUTER_WALL: "External perimeter", Role.INNER_WALL: "Perimeter", Role.SOLID_INFILL: "Solid infill",
    Role.TOP_SKIN: "Top solid infill", Role.SPARSE_INFILL: "Internal infill", Role.BRIDGE: "Bridge infill",
    Role.GAP_FILL: "Gap fill", Role.SKIRT: "Skirt/Brim", Role.SUPPORT: "Support material",
    Role.SUPPORT_INTERFACE: "Support material interface", Role.IRONING: "Ironing",
    Role.OVERHANG_WALL: "Overhang perimeter", Role.CUSTOM: "Custom",
}

_OTHERS = {
    Role.OUTER_WALL: ("outer wall", "wall-outer", "external perimeters"),
    Role.INNER_WALL: ("inner wall", "wall-inner", "perimeters"),
    Role.SOLID_INFILL: ("internal solid infill", "bottom surface", "floating vertical shell", "skin", "infill (solid)"),
    Role.TOP_SKIN: ("top surface", "infill (top solid)"),
    Role.SPARSE_INFILL: ("sparse infill", "fill", "infill"),
    Role.BRIDGE: ("bridge", "internal bridge infill", "internal bridge"),
    Role.GAP_FILL: ("gap infill", "thin wall"),
    Role.SKIRT: ("skirt", "brim", "raft"),
    Role.SUPPORT: ("support", "support transition"),
    Role.SUPPORT_INTERFACE: ("support interface", "support-interface"),
    Role.OVERHANG_WALL: ("overhang wall",),
    Role.CUSTOM: ("prime tower", "prime-tower", "wipe tower", "draft shield", "undefined", "none", "unknown"),
}
ROLE_OF = {name.lower(): role for role, name in PRUSA_NAME.items()} | {
    name: role for role, names in _OTHERS.items() for name in names
}

IGNORED = {"G17", "G21", "G29", "G54", "G80", "G91.1", "G94", "T0", "T-1"}   # read elsewhere or of no account here
SPEECHLESS = {f"M{n}" for n in (
    17, 18, 73, 74, 75, 76, 77, 80, 84, 105, 108, 110, 114, 115, 117, 118, 155, 201, 202, 203, 204, 205, 206, 207, 208,
    209, 211, 217, 280, 300, 301, 302, 304, 400, 413, 420, 450, 500, 501, 502, 555, 569, 572, 593, 665, 666, 701, 862,
    900, 906, 907, 914, 960, 970, 971, 972, 973, 974, 975, 991, 993, 1002, 1003, 1006,
)} | {"SET_PRESSURE_ADVANCE", "EXCLUDE_OBJECT_DEFINE", "EXCLUDE_OBJECT_END"}
PAUSES = {"M0", "M1", "M25", "M226", "M601", "PAUSE"}

_WORD = re.compile(r"([A-Z*])\s*([+-]?(?:\d+\.?\d*|\.\d+))")


def parse(text: str) -> dict[str, float]:
    """The words of a command without its name: {"X": 1.0, ...}; a letter alone is 0. Raises ValueError for others."""
    found = {}
    try:
        for word in text.split():
            found[word[0]] = float(word[1:])
    except ValueError:
        return _parse_slowly(text.upper())
    return found if text.isupper() or not found else {letter.upper(): number for letter, number in found.items()}


def _parse_slowly(text: str) -> dict[str, float]:
    """The same for words without spaces between them, and for letters alone (G28 X)."""
    found = {letter: float(number) for letter, number in _WORD.findall(text)}
    rest = _WORD.sub(" ", text).split()
    if any(len(word) > 1 or not word.isalpha() for word in rest):
        raise ValueError(f"{text.strip()!r} is not a list of words such as X1.5")
    return found | dict.fromkeys(rest, 0.0)
