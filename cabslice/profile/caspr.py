"""Robots of CASPR: a bodies and a cables file (XML) to a printer profile. CASPR is in metres.

Legend (CASPR, Lau, Eden, Tan, Oetomo 2016; data/model_config)
    link_rigid             the platform: joint (its kind gives the freedoms, q_initial the home), mass, com_location,
                           inertia about the centre of mass ("com") or the joint, parent location
    cable_set              one choice of cables; default_cable_set names the one that is meant
    cable_ideal, ...       force_min, force_max; K of a linear spring: N per unit strain
    attachment             on link 0 (the frame) and on link 1, from its joint or its centre of mass
    base_rotating_pulley   in place of the first one: fixed_location, pulley_radius, cable_entry_vector
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cabslice.errors import ProfileError
from cabslice.profile.imported import ASSUMED, Builder, Imported, name_from, text_of

ALL = ("x", "y", "z", "rx", "ry", "rz")
JOINTS = {
    "SPATIAL_EULER_XYZ": ALL, "SPATIAL_QUATERNION": ALL, "T_XYZ": ALL[:3], "P_XY": ("x", "y"), "P_XZ": ("x", "z"),
    "PLANAR_XY": ("x", "y", "rz"), "PLANAR_XZ": ("x", "z", "ry"), "PLANAR_YZ": ("y", "z", "rx"),
    "S_EULER_XYZ": ALL[3:], "S_FIXED_XYZ": ALL[3:], "S_QUATERNION": ALL[3:],
}
STIFF = 1e5                                # N per unit strain, where the cables are said to be ideal


def read_pair(paths: Sequence[Path], name: str | None = None, cable_set: str | None = None) -> Imported:
    """The robot of a bodies and a cables file, in any order. Raises ProfileError with every fault: file, line."""
    roots = {root.tag: (path, root) for path in paths for root in [_root(path)]}
    if len(paths) != 2 or set(roots) != {"bodies_system", "cables"}:
        found = ", ".join(f"<{tag}>" for tag in roots)
        raise ProfileError(str(paths[0]), [f"expected a <bodies_system> and a <cables> file of CASPR, found {found}"])
    (bodies, body), (cables, cable) = roots["bodies_system"], roots["cables"]
    builder = Builder(f"{bodies} with {cables.name}")
    links = body.findall(".//link_rigid")
    if len(links) != 1:
        builder.fault(_where(bodies, body), f"expected one <link_rigid>, as there is one platform, found {len(links)}")
    chosen = _chosen(builder, cables, cable, cable_set)
    builder.stop()
    rows = [row for row in chosen if isinstance(row.tag, str)]
    builder.values["cable"] = [{} for _ in rows]
    arm = _platform(builder, bodies, links[0])
    for index, row in enumerate(rows):
        _cable(builder, cables, index, row, arm)
    builder.stop()
    _rest(builder)
    plain = name_from(bodies.stem.removesuffix("_bodies"))
    source = f"CASPR: {bodies.name}, {cables.name}, cable set {chosen.get('id')}"
    return builder.finish(name or plain, f"CASPR robot {links[0].get('name') or plain}", source)


def _root(path: Path) -> Any:
    """The document, its comments left out. Raises ProfileError with the line of a syntax error."""
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True)
    try:
        return etree.fromstring(text_of(path).encode(), parser)
    except etree.XMLSyntaxError as error:
        raise ProfileError(str(path), [f"line {error.lineno or 1}: not valid XML: {error.msg}"]) from error


def _where(path: Path, element: Any) -> str:
    return f"{path.name}, line {element.sourceline}"


def _chosen(builder: Builder, path: Path, root: Any, wanted: str | None) -> Any:
    sets = {one.get("id"): one for one in root.findall("cable_set")}
    asked = wanted or root.get("default_cable_set") or next(iter(sets), "")
    if asked not in sets:
        builder.fault(_where(path, root), f"there is no cable set {asked!r}; there are: {', '.join(sets) or 'none'}")
        return None
    if len(sets) > 1:
        builder.left_out.append(f"{path.name}: the cable sets {', '.join(one for one in sets if one != asked)}")
    return sets[asked]


def _numbers(builder: Builder, path: Path, parent: Any, tag: str, count: int) -> list[float]:
    """The numbers in a child element; nan and a fault where there are not `count` of them."""
    child = parent.find(tag)
    if child is None:
        builder.fault(_where(path, parent), f"<{parent.tag}> has no <{tag}>, expected {_many(count)} in it")
        return [math.nan] * count
    return _parsed(builder, _where(path, child), f"<{tag}>", child.text or "", count)


def _parsed(builder: Builder, where: str, what: str, text: str, count: int) -> list[float]:
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(math.isfinite(value) for value in values):
        builder.fault(where, f"{what}: expected {_many(count)}, found {text.strip() or 'nothing'}")
        return [math.nan] * count
    return values


def _many(count: int) -> str:
    return "a number" if count == 1 else f"{count} numbers"


def _mm(metres: Sequence[float]) -> list[float]:
    """Metres to mm, without the dust of the multiplication."""
    return [round(one * 1e3, 9) + 0.0 for one in metres]


# ---- the platform

def _platform(builder: Builder, path: Path, link: Any) -> list[float]:
    """Freedoms, home, mass and inertia; the centre of mass (3,) mm from the joint."""
    joint, physical = link.find("joint"), link.find("physical")
    if joint is None or physical is None:
        builder.fault(_where(path, link), "<link_rigid> needs a <joint> and a <physical>")
        builder.stop()
    _joint(builder, path, link, joint)
    (mass,) = _numbers(builder, path, physical, "mass", 1)
    builder.read(("platform", "mass_kg"), mass, _where(path, physical))
    centre = _mm(_numbers(builder, path, physical, "com_location", 3))
    builder.read(("platform", "centre_of_mass_mm"), centre, _where(path, physical))
    inertia = physical.find("inertia")
    if inertia is None:
        builder.fault(_where(path, physical), "<physical> has no <inertia>")
    else:
        _inertia(builder, path, inertia, mass, centre)
    return centre


def _joint(builder: Builder, path: Path, link: Any, joint: Any) -> None:
    kind, where = joint.get("type", ""), _where(path, joint)
    if kind not in JOINTS:
        builder.fault(where, f"joint type {kind!r}: expected one of {', '.join(JOINTS)}")
        return
    freedoms = JOINTS[kind]
    builder.read(("freedoms",), list(freedoms), where)
    parent = link.find("parent")
    base = [0.0] * 3 if parent is None else _numbers(builder, path, parent, "location", 3)
    count = len(freedoms) + ("QUATERNION" in kind)
    text = joint.get("q_initial") or " ".join(["0"] * count)
    start = _parsed(builder, where, "q_initial", text, count)
    moves = {freedom: value for freedom, value in zip(freedoms, start, strict=False) if len(freedom) == 1}
    home = [one + moves.get(axis, 0.0) for axis, one in zip("xyz", base, strict=True)]
    builder.read(("platform", "home_mm"), _mm(home), where)
    turn = start[len(moves):]
    if any(turn[1:] if "QUATERNION" in kind else turn):
        builder.left_out.append(f"{where}: q_initial turns the platform; at home it is level here")
    limits = [limit for limit in ("q_min", "q_max") if joint.get(limit)]
    builder.left_out += [f"{where}: {limit} is not part of a profile" for limit in limits]


def _inertia(builder: Builder, path: Path, inertia: Any, mass: float, centre: list[float]) -> None:
    where = _where(path, inertia)
    names = ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
    values = [_numbers(builder, path, inertia, name, 1)[0] * 1e6 for name in names]
    if inertia.get("ref") == "joint":                       # by the parallel axis theorem to the centre of mass
        x, y, z = centre
        moved = (y * y + z * z, x * x + z * z, x * x + y * y, -x * y, -x * z, -y * z)
        values = [one - mass * arm for one, arm in zip(values, moved, strict=True)]
    diagonal, products = [round(one, 6) for one in values[:3]], [round(one, 6) + 0.0 for one in values[3:]]
    largest = max(diagonal)
    if min(diagonal) <= 0 < largest:                        # planar robots leave out what does not turn
        builder.assume({("platform", "inertia_kg_mm2"): [one if one > 0 else largest for one in diagonal]},
                       f"{where} has zeros; in their place its largest moment")
    else:
        builder.read(("platform", "inertia_kg_mm2"), diagonal, where)
    builder.read(("platform", "inertia_products_kg_mm2"), products, where)


# ---- the cables

def _cable(builder: Builder, path: Path, index: int, row: Any, arm: list[float]) -> None:
    where = f"{_where(path, row)}, {row.get('name') or f'cable {index + 1}'}"
    properties, ends = row.find("properties"), row.find("attachments")
    points = [] if ends is None else list(ends)
    if properties is None or len(points) != 2:
        builder.fault(where, "expected <properties>, and in <attachments> an end on the frame and one on the platform, "
                             f"found {len(points)} ends")
        return
    for tag, key in (("force_min", "min_tension_n"), ("force_max", "max_tension_n")):
        builder.read(("cable", index, key), _numbers(builder, path, properties, tag, 1)[0], where)
    if properties.find("K") is not None:
        builder.read(("cable", index, "axial_stiffness_n"), _numbers(builder, path, properties, "K", 1)[0], where)
    _frame_end(builder, path, index, points[0])
    _link(builder, path, points[1], "1")
    place = _mm(_numbers(builder, path, points[1], "location", 3))
    if row.get("attachment_reference") == "com":
        place = [one + two for one, two in zip(place, arm, strict=True)]
    builder.read(("cable", index, "attachment_mm"), place, _where(path, points[1]))


def _frame_end(builder: Builder, path: Path, index: int, end: Any) -> None:
    where = _where(path, end)
    if end.tag == "attachment":
        _link(builder, path, end, "0")
        builder.read(("cable", index, "anchor_mm"), _mm(_numbers(builder, path, end, "location", 3)), where)
        return
    if end.tag != "base_rotating_pulley":
        builder.fault(where, f"<{end.tag}>: expected <attachment> or <base_rotating_pulley>")
        return
    builder.read(("cable", index, "anchor_mm"), _mm(_numbers(builder, path, end, "fixed_location", 3)), where)
    (radius,) = _mm(_numbers(builder, path, end, "pulley_radius", 1))
    builder.read(("cable", index, "pulley", "groove_radius_mm"), radius, where)
    axis = _numbers(builder, path, end, "cable_entry_vector", 3)
    length = math.hypot(*axis) or 1.0
    builder.read(("cable", index, "pulley", "axis"), [one / length for one in axis], where)


def _link(builder: Builder, path: Path, end: Any, wanted: str) -> None:
    found = (end.findtext("link") or "").strip()
    if found != wanted:
        what = "the frame" if wanted == "0" else "the platform"
        builder.fault(_where(path, end), f"expected <link>{wanted}</link>, {what}, found {found or 'none'}")


def _rest(builder: Builder) -> None:
    """What CASPR does not say."""
    cables = builder.values["cable"]
    builder.assume({("cables", "diameter_mm"): 0.0, ("cables", "clearance_mm"): 0.0}, "lines without thickness")
    if any("axial_stiffness_n" not in cable for cable in cables):
        for index, cable in enumerate(cables):
            if "axial_stiffness_n" not in cable:
                builder.read(("cable", index, "axial_stiffness_n"), STIFF, ASSUMED)
        builder.assumed.append(f"cables.axial_stiffness_n: {STIFF:g} N where a cable is ideal")
    for index, cable in enumerate(cables):
        low, high = cable["min_tension_n"], cable["max_tension_n"]
        builder.read(("cable", index, "reference_tension_n"), round(low + (high - low) / 10, 6), ASSUMED)
    builder.assumed.append("cables.reference_tension_n: a tenth of the way from the lower to the upper bound")
    if any("pulley" in cable for cable in cables):
        builder.assumed.append("cables.pulley.axis: cable_entry_vector is the way the cable goes where it comes in")
