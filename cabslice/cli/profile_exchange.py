"""cabslice profile import, export, diff: other programs' robots, and profiles beside each other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cabslice.cli import options
from cabslice.cli.profile_names import checked_name, kind_of, target
from cabslice.cli.report import Table, Talk
from cabslice.errors import ProfileError, UsageError

if TYPE_CHECKING:
    from cabslice.profile.imported import Imported

FORMATS = ("reprap",)
SUFFIXES = {"reprap": "g"}
SETTINGS = (".ini", ".gcode", ".gco", ".curaprofile", ".cfg", ".json")  # profile.slicers.SUFFIXES, imported late
WIDEST = 60          # characters of a value in the table of differences


@click.command("import")
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option("--name", help="Name of the profile; default: what the files call it.")
@click.option("--cable-set", metavar="ID", help="Which cable set of a CASPR file; default: the one it names.")
@click.option("-o", "--output", "to", metavar="FILE|DIR/|-", help="Default: NAME.toml, here.")
@click.option("--overwrite", is_flag=True, help="Replace the file if it exists.")
@options.talk
def import_(
    files: tuple[str, ...], name: str | None, cable_set: str | None, to: str | None, overwrite: bool, talk: Talk
) -> None:
    """Make a printer profile of another program's files, or a process and a material of another slicer's settings.

    Settings: an .ini or G-code of PrusaSlicer; a .curaprofile, .cfg or G-code of Cura; a .json of
    OrcaSlicer. NAME.toml is the process,
    NAME-material.toml the material; what the file does not say is inherited, what has no place here is named.

    One config.g of a Hangprinter (RepRapFirmware: M669, M666, M208), or a bodies and a cables file of CASPR (XML). The
    profile says behind each value which line it is from; what the files do not say is assumed, and marked so. Exit
    code 3 where a file is wrong, with its line and what was expected.
    """
    from cabslice.files import atomic

    if to == "-" and talk.json:
        raise UsageError("-o - and --json both want stdout: choose one.")
    if name is not None:
        checked_name(name)
    if any(file.lower().endswith(SETTINGS) for file in files):
        if len(files) != 1 or cable_set:
            raise UsageError("Settings of a slicer are imported one file at a time, without --cable-set.")
        _settings(Path(files[0]), name, to, overwrite, talk)
        return
    made = _imported([Path(file) for file in files], name, cable_set)
    path = target(to, made.model.name)
    with atomic(path, overwrite) as file:
        file.write(made.toml.encode())
    for sentence in made.left_out:
        talk.say(f"left out: {sentence}")
    if path != "-":
        talk.answer({
            "ok": True, "command": "profile import", "name": made.model.name, "output": path,
            "assumed": made.model.assumed, "left_out": made.left_out,
        }, f"wrote {path}; {len(made.model.assumed)} entries are assumed",
            f"next: read what is marked as assumed, then cabslice profile check {path}")


def _settings(file: Path, name: str | None, to: str | None, overwrite: bool, talk: Talk) -> None:
    from cabslice.files import atomic
    from cabslice.profile.slicers import read_settings

    if to == "-":
        raise UsageError("A process and a material are two files: give -o a folder, or none.")
    if not file.is_file():
        raise ProfileError(str(file), ["there is no such file"])
    made = read_settings(file, name)
    paths = target(to, made.process.name), target(to and str(Path(to).parent) + "/", made.material.name)
    if to and (to.endswith("/") or Path(to).is_dir()):
        paths = paths[0], target(to, made.material.name)
    for path in paths:
        options.claim(path, overwrite)
    for path, text in zip(paths, (made.process_toml, made.material_toml), strict=True):
        with atomic(path, overwrite) as out:
            out.write(text.encode())
    if made.left_out:
        talk.say(f"not taken: {', '.join(made.left_out)}")
    talk.answer(
        {"ok": True, "command": "profile import", "name": made.process.name, "outputs": list(paths),
         "left_out": made.left_out},
        f"wrote {paths[0]} and {paths[1]}; {len(made.left_out)} settings have no place here",
        f"next: cabslice slice PART --process {paths[0]} -m {paths[1]}, or cabslice profile diff",
    )


def _imported(paths: list[Path], name: str | None, cable_set: str | None) -> Imported:
    for path in paths:
        if not path.is_file():
            raise ProfileError(str(path), ["there is no such file"])
    xml = [path.suffix.lower() == ".xml" for path in paths]
    if all(xml) and len(paths) == 2:
        from cabslice.profile.caspr import read_pair

        return read_pair(paths, name, cable_set)
    if len(paths) != 1 or any(xml):
        raise UsageError("Give one config.g of RepRapFirmware, or the bodies and the cables .xml of a CASPR robot.")
    if cable_set:
        raise UsageError("--cable-set is for CASPR files.")
    from cabslice.profile.reprap import read_config

    return read_config(paths[0], name)


@click.command("export")
@click.argument("ref", metavar="NAME|FILE")
@click.option("--format", "format_", type=click.Choice(FORMATS), required=True,
              help="reprap: the M669, M666 and M208 lines of a Hangprinter's config.g.")
@click.option("-s", "--set", "sets", multiple=True, metavar="TABLE.KEY=VALUE", help="Change one key. Repeatable.")
@click.option("-o", "--output", "to", metavar="FILE|DIR/|-", help="Default: NAME.g, here.")
@click.option("--overwrite", is_flag=True, help="Replace the file if it exists.")
@options.talk
def export(ref: str, format_: str, sets: tuple[str, ...], to: str | None, overwrite: bool, talk: Talk) -> None:
    """Write a printer as another program wants it. Exit code 3, with every reason, where that has no words for it."""
    from cabslice.files import atomic
    from cabslice.profile import shelf
    from cabslice.profile.reprap_lines import write_config

    if to == "-" and talk.json:
        raise UsageError("-o - and --json both want stdout: choose one.")
    printer = shelf.load_printer(ref, sets)
    text = write_config(printer)
    path = target(to, printer.name, SUFFIXES[format_])
    with atomic(path, overwrite) as file:
        file.write(text.encode())
    if path != "-":
        talk.answer({"ok": True, "command": "profile export", "name": printer.name, "format": format_, "output": path},
                    f"wrote {path}; next: put its lines into config.g")


@click.command("diff")
@click.argument("first", metavar="NAME|FILE")
@click.argument("second", metavar="NAME|FILE")
@click.option("--kind", type=click.Choice(["printer", "material", "process"]),
              help="What they are, where the names do not tell.")
@options.talk
def diff(first: str, second: str, kind: str | None, talk: Talk) -> None:
    """Two profiles beside each other: every key that differs, after inheritance. Exit code 0 either way."""
    from cabslice.profile import shelf
    from cabslice.profile.compare import differences

    folders = [kind_of(ref, kind) for ref in (first, second)]
    if folders[0] != folders[1]:
        what = " and ".join(f"{ref} is a {shelf.SINGULAR[folder]}" for ref, folder in
                            zip((first, second), folders, strict=True))
        raise UsageError(f"{what}: there is nothing to compare.")
    found = differences(*(shelf.load(folders[0], ref) for ref in (first, second)))
    rows = [(one.key, _short(one.first), _short(one.second)) for one in found]
    count = f"{len(found)} keys differ" if len(found) > 1 else "1 key differs" if found else "no key differs"
    talk.answer({
        "ok": True, "command": "profile diff", "kind": shelf.SINGULAR[folders[0]], "same": not found,
        "differences": [one._asdict() for one in found],
    }, Table(("key", first, second), rows) if found else "", count)


def _short(value: Any) -> str:
    from cabslice.profile.toml import literal

    if value is None:
        return "-"
    if isinstance(value, list) and value and all(isinstance(one, str) for one in value) and len(value) > 6:
        return f"{len(value)} entries"
    text = literal(value)
    return text if len(text) <= WIDEST else text[:WIDEST - 3] + "..."
