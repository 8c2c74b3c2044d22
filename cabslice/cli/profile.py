"""cabslice profile: printers, materials and processes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from cabslice.cli import options, profile_exchange
from cabslice.cli.profile_names import KINDS, checked_name, kind_of, kind_option, target
from cabslice.cli.report import Table, Talk
from cabslice.errors import ProfileError, UsageError


@click.group("profile")
def profile() -> None:
    """Printers, materials and processes: what there is, what a file says, what is wrong with it."""


for command in (profile_exchange.import_, profile_exchange.export, profile_exchange.diff):
    profile.add_command(command)


@profile.command("list")
@click.argument("kind", type=click.Choice(list(KINDS)), required=False)
@options.talk
def list_(kind: str | None, talk: Talk) -> None:
    """The profiles that can be asked for by name; with -v also where they lie."""
    from cabslice.profile import shelf

    kinds = [kind] if kind else list(KINDS)
    found = {KINDS[one]: [_entry(one, name) for name in shelf.names(KINDS[one])] for one in kinds}
    head = ("kind", "name", "what", "file") if talk.verbose else ("kind", "name", "what")
    rows = [tuple(entry.values())[:len(head)] for entries in found.values() for entry in entries]
    talk.answer({"ok": True, "command": "profile list", "default_printer": shelf.default_printer(), **found},
                Table(head, rows))


def _entry(kind: str, name: str) -> dict[str, str]:
    from cabslice.profile import shelf

    path = shelf.find(KINDS[kind], name)
    return {"kind": kind, "name": name, "description": shelf.description(path), "file": str(path)}


@profile.command("show")
@click.argument("ref", metavar="NAME|FILE")
@kind_option
@click.option("-s", "--set", "sets", multiple=True, metavar="TABLE.KEY=VALUE", help="Change one key. Repeatable.")
@options.talk
def show(ref: str, kind: str | None, sets: tuple[str, ...], talk: Talk) -> None:
    """One profile as it is after inheritance and --set, with the file that gave each value.

    The text is TOML: a profile file of its own, without parents.
    """
    from cabslice.profile import shelf
    from cabslice.profile.faults import dotted
    from cabslice.profile.shown import show as shown

    folder = kind_of(ref, kind)
    one = shown(folder, ref, sets)
    talk.answer({
        "ok": True, "command": "profile show", "kind": shelf.SINGULAR[folder], "name": one.model.name,
        "files": one.files, "sha256": shelf.profile_hash(one.model), "values": one.values,
        "origins": {dotted(place): label for place, label in one.origins.items()},
    }, one.toml.rstrip("\n"))


@profile.command("check")
@click.argument("ref", metavar="NAME|FILE")
@kind_option
@options.talk
def check(ref: str, kind: str | None, talk: Talk) -> None:
    """Is this profile right? Exit code 0 yes; 3 no, with every fault: file, key, what was expected.

    Of a printer also: do its cables hold the platform at home?
    """
    from cabslice.profile import shelf
    from cabslice.profile.summary import summary

    folder = kind_of(ref, kind)
    files = [sheet.label for sheet in shelf.chain(folder, ref)]
    model = shelf.load(folder, ref)
    if folder == "printers":
        _stands(files[-1], model)
    sentence = summary(folder, model)
    talk.answer({
        "ok": True, "command": "profile check", "kind": shelf.SINGULAR[folder], "name": model.name, "files": files,
        "sha256": shelf.profile_hash(model), "sentence": sentence, "assumed": getattr(model, "assumed", []),
    }, sentence)
    talk.detail("\n".join(f"assumed: {one}" for one in getattr(model, "assumed", [])) or "nothing assumed")


def _stands(file: str, model: Any) -> None:
    """Raises ProfileError where the robot cannot be at home."""
    from cabslice.robot.model import robot_from_printer
    from cabslice.robot.sound import faults

    if model.kind != "cable":
        return                             # the relations of its keys have said so
    robot = robot_from_printer(model)
    found = [fault.sentence.replace(" at pose 0:", ":") for fault in faults(robot, robot.home)]
    if found:
        place = " ".join(f"{x:g}" for x in model.platform.home_mm)
        raise ProfileError(file, [f"at home ({place} mm): {sentence}" for sentence in found])


@profile.command("keys")
@click.argument("kind", type=click.Choice(list(KINDS)))
@options.talk
def keys_(kind: str, talk: Talk) -> None:
    """Every key of a kind of profile: type, bound, unit, default, meaning."""
    from cabslice.profile.keys import keys
    from cabslice.profile.toml import literal

    every = [key for key in keys(KINDS[kind]).values() if not key.table]
    rows = [
        (key.dotted, " ".join(filter(None, (key.type, key.bound))), key.unit,
         "required" if key.required else "" if key.default is None else literal(key.default), key.description)
        for key in every
    ]
    note = ["cable.KEY stands in [cables] for all cables, in a [[cable]] for one; --set cables.KEY= or cable.3.KEY="]
    talk.answer({"ok": True, "command": "profile keys", "kind": kind, "keys": [key.as_dict() for key in every]},
                Table(("key", "type", "unit", "default", "what"), rows), *(note if kind == "printer" else []))


@profile.command("new")
@click.argument("name")
@click.option("--kind", type=click.Choice(list(KINDS)), help="What it is; default: as --from, else a printer.")
@click.option("--from", "parent", metavar="NAME", help="Inherit from this profile.")
@click.option("-o", "--output", "to", metavar="FILE|DIR/|-", help="Default: NAME.toml, here.")
@click.option("--overwrite", is_flag=True, help="Replace the file if it exists.")
@options.talk
def new(name: str, kind: str | None, parent: str | None, to: str | None, overwrite: bool, talk: Talk) -> None:
    """Write a profile file to start from: every key with what it means, as a comment."""
    from cabslice.files import atomic
    from cabslice.profile.shown import starter

    checked_name(name)
    if to == "-" and talk.json:
        raise UsageError("-o - and --json both want stdout: choose one.")
    folder = KINDS[kind] if kind else kind_of(parent, None) if parent else "printers"
    path = target(to, name)
    text = starter(folder, name, parent, beside=None if path == "-" else Path(path).parent)
    with atomic(path, overwrite) as file:
        file.write(text.encode())
    if path != "-":
        talk.answer({"ok": True, "command": "profile new", "name": name, "output": path},
                    f"wrote {path}; next: edit it, then cabslice profile check {path}")


@profile.command("use")
@click.argument("name", metavar="NAME|FILE")
@options.talk
def use(name: str, talk: Talk) -> None:
    """Make this the printer when -p and CABSLICE_PRINTER are absent."""
    from cabslice.profile import shelf

    printer = shelf.load_printer(name)
    path = shelf.set_default_printer(name)
    missing = [table for table in shelf.PRINTING if getattr(printer, table) is None]
    note = f"It cannot print yet: its profile says nothing of {', '.join(missing)}." if missing else ""
    talk.answer({"ok": True, "command": "profile use", "printer": name, "output": str(path), "missing": missing},
                f"{name} is the printer from now on ({path})", note)
