"""Where profiles lie, and how to take one: by name or path, parents laid under it, options over it, checked.

A profile NAME of a kind (printers, materials, processes) is the first FOLDER/kind/NAME.toml of the search path:
./profiles, each folder of CABSLICE_PROFILES, the user's folder, the shipped ones. A reference that ends in .toml or
has a path separator is a file. A parent named by ``inherits`` is looked for beside its child first; a file may
inherit the profile of its own name from further down the search path.
"""

from __future__ import annotations

import hashlib
import json
import os
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cabslice.errors import OutputError, ProfileError
from cabslice.files import atomic
from cabslice.profile.reader import Draft, Sheet, merge, parse_set, read_sheet
from cabslice.profile.toml import dump

if TYPE_CHECKING:
    from cabslice.profile.material import Material
    from cabslice.profile.printer import Printer
    from cabslice.profile.process import Process

SINGULAR = {"printers": "printer", "materials": "material", "processes": "process"}
PRINTING = ("nozzle", "extruder", "bed", "motion")


# ---- finding

def folders() -> list[Path]:
    """The search path, first found wins; folders that do not exist are left out."""
    listed = [Path(one) for one in os.environ.get("CABSLICE_PROFILES", "").split(os.pathsep) if one]
    candidates = [Path("profiles"), *listed, user_folder() / "profiles", *_shipped()]
    return list({one.resolve(): one for one in reversed(candidates) if one.is_dir()}.values())[::-1]


def user_folder() -> Path:
    """Where the user's own profiles and config.toml live."""
    base = os.environ.get("XDG_CONFIG_HOME")
    return (Path(base) if base else Path.home() / ".config") / "cabslice"


def _shipped() -> Iterator[Path]:
    package = Path(__file__).parents[1]
    yield package / "_profiles"                                # in a wheel
    if (package.parent / "pyproject.toml").is_file():          # in an editable install
        yield package.parent / "profiles"


def names(kind: str) -> list[str]:
    """All profiles of a kind that can be asked for by name, sorted."""
    return sorted({path.stem for folder in folders() for path in (folder / kind).glob("*.toml")})


def find(kind: str, ref: str | os.PathLike[str]) -> Path:
    """The file of a profile given by name or path. Raises ProfileError that lists close names."""
    if _is_path(ref):
        if not Path(ref).is_file():
            raise ProfileError(str(ref), [f"there is no such file; expected a {SINGULAR[kind]} profile"])
        return Path(ref)
    for path in _candidates(kind, str(ref)):
        return path
    raise ProfileError(str(ref), [unknown_name([kind], str(ref))])


def kinds_of(ref: str | os.PathLike[str]) -> list[str]:
    """The kinds that have a profile of this name; of a file, those its folder, its keys and its parents allow."""
    if not _is_path(ref):
        return [kind for kind in SINGULAR if next(_candidates(kind, str(ref)), None)]
    path, left, seen = Path(ref), list(SINGULAR), set()
    while len(left) > 1 and path.resolve() not in seen:
        seen.add(path.resolve())
        values = read_sheet(find("printers", path)).values
        left = _alike(values, path.resolve().parent.name, left)
        parent = values.get("inherits")
        if not isinstance(parent, str):
            break
        if not _is_path(parent):
            return [kind for kind in left if next(_candidates(kind, parent), None)] or left
        path = path.parent / parent
    return left


def _alike(values: dict[str, Any], folder: str, kinds: list[str]) -> list[str]:
    """Of these kinds the one that `folder` is called, else those that know most of the keys."""
    from cabslice.profile.keys import keys

    score = {kind: len(set(values) & {"cables", *(path[0] for path in keys(kind))}) for kind in kinds}
    best = [kind for kind in kinds if score[kind] == max(score.values())]
    return [folder] if folder in best else best


def seen_from(ref: str, folder: Path) -> str:
    """A reference as a profile in `folder` writes it behind ``inherits``: names stay, files become relative."""
    return Path(os.path.relpath(ref, folder)).as_posix() if _is_path(ref) else ref


def _is_path(ref: str | os.PathLike[str]) -> bool:
    text = os.fspath(ref)
    return text.endswith(".toml") or os.sep in text or "/" in text


def _candidates(kind: str, name: str) -> Iterator[Path]:
    yield from (path for folder in folders() if (path := folder / kind / f"{name}.toml").is_file())


def unknown_name(kinds: Sequence[str], name: str) -> str:
    """A sentence that tells the names like this one, or else all names."""
    from cabslice.profile.keys import close

    known = [one for kind in kinds for one in names(kind)]
    near = close(name, known)
    hint = f"did you mean {' or '.join(near)}?" if near else f"there are: {', '.join(known) or 'none'}"
    return f"there is no {' or '.join(SINGULAR[kind] for kind in kinds)} of this name; {hint}"


# ---- reading

def chain(kind: str, ref: str | os.PathLike[str]) -> list[Sheet]:
    """The files of a profile, from its furthest parent to itself. Raises ProfileError: no such parent, a circle."""
    path: Path | None = find(kind, ref)
    paths: list[Path] = []
    sheets: list[Sheet] = []
    while path:
        sheets.insert(0, read_sheet(path))
        paths.append(path.resolve())
        path = _parent(kind, path, sheets[0], paths)
    return sheets


def _parent(kind: str, path: Path, sheet: Sheet, seen: list[Path]) -> Path | None:
    name = sheet.values.get("inherits")
    if name is None:
        return None
    if not isinstance(name, str) or not name:
        wanted = f"the name or the file of a {SINGULAR[kind]} profile"
        raise ProfileError(sheet.label, [f"inherits: expected {wanted}, found {name!r}"])
    options = [path.parent / name] if _is_path(name) else [path.parent / f"{name}.toml", *_candidates(kind, name)]
    options = [one for one in options if one.is_file()]
    for one in options:
        if one.resolve() not in seen:
            return one
    if options:
        circle = " -> ".join([*(one.stem for one in seen), Path(name).stem if _is_path(name) else name])
        raise ProfileError(sheet.label, [f"inherits: goes round in a circle: {circle}"])
    missing = f"there is no file {options or path.parent / name}" if _is_path(name) else unknown_name([kind], name)
    raise ProfileError(sheet.label, [f'inherits = "{name}": {missing}'])


def draft(kind: str, ref: str | os.PathLike[str], sets: Sequence[str] = ()) -> Draft:
    """The merged profile before it is checked, with the origin of each value."""
    return merge(chain(kind, ref), sets, cables=kind == "printers")


def load(kind: str, ref: str | os.PathLike[str], sets: Sequence[str] = ()) -> Any:
    """A checked, frozen profile. Raises ProfileError with every fault of it."""
    from cabslice.profile.faults import checked

    return checked(kind, draft(kind, ref, sets))


def load_printer(ref: str | os.PathLike[str], sets: Sequence[str] = ()) -> Printer:
    """The printer of this name or file, with ``table.key=value`` options laid over it. Raises ProfileError."""
    return load("printers", ref, sets)


def load_material(ref: str | os.PathLike[str], sets: Sequence[str] = ()) -> Material:
    """The material of this name or file, as `load_printer`."""
    return load("materials", ref, sets)


def load_process(ref: str | os.PathLike[str], sets: Sequence[str] = ()) -> Process:
    """The process of this name or file, as `load_printer`."""
    return load("processes", ref, sets)


# ---- options, defaults, identity

def split_sets(sets: Sequence[str]) -> tuple[list[str], list[str], list[str]]:
    """``table.key=value`` options sorted by the profile that has the key: printer, material, process.

    Raises UsageError where one has no "=", ProfileError with did-you-mean where no profile has its key.
    """
    from cabslice.profile.keys import KINDS, keys, suggest_option

    sorted_: dict[str, list[str]] = {kind: [] for kind in KINDS}
    faults = []
    for option in sets:
        path = _without_position(parse_set(option)[0])
        owner = next((kind for kind in KINDS if path in keys(kind)), None)
        if owner:
            sorted_[owner].append(option)
        else:
            near = suggest_option(path)
            hint = f"; did you mean {' or '.join(near)}?" if near else ""
            faults.append(f"{option.partition('=')[0].strip()}: unknown key{hint}")
    if faults:
        raise ProfileError("--set", faults)
    return sorted_["printers"], sorted_["materials"], sorted_["processes"]


def _without_position(key: tuple[str, ...]) -> tuple[str, ...]:
    """cables.x and cable.3.x are both cable.x in the list of keys."""
    if key[0] == "cables" and len(key) > 1:
        return ("cable", *key[1:])
    return (key[0], *key[2:]) if key[0] == "cable" and len(key) > 2 and key[1].isdigit() else key


def default_printer() -> str | None:
    """CABSLICE_PRINTER, else `printer` in the user's config.toml, else None. Raises ProfileError if that is broken."""
    return os.environ.get("CABSLICE_PRINTER") or _configured()


def _configured() -> str | None:
    path = user_folder() / "config.toml"
    if not path.is_file():
        return None
    values = read_sheet(path).values
    if unknown := [key for key in values if key != "printer"]:
        raise ProfileError(str(path), [f"{key}: unknown key; did you mean printer?" for key in unknown])
    if not isinstance(values.get("printer", ""), str):
        wanted = "the name or the file of a printer"
        raise ProfileError(str(path), [f"printer: expected {wanted}, found {values['printer']!r}"])
    return values.get("printer") or None


def set_default_printer(ref: str) -> Path:
    """Write `ref` (a file: by its full path) into the user's config.toml; the file written. Raises OutputError."""
    path = user_folder() / "config.toml"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{path.parent} cannot be made: {error.strerror}.", file=str(path)) from error
    with atomic(path, overwrite=True) as file:
        file.write(dump({"printer": str(Path(ref).resolve()) if _is_path(ref) else ref}).encode())
    return path


def profile_hash(model: Any) -> str:
    """sha256 of the canonical JSON of a checked profile: the same for every way to write the same values."""
    values = model.model_dump(mode="json", by_alias=True)
    return hashlib.sha256(json.dumps(values, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def require_printing(printer: Printer) -> None:
    """Raises ProfileError that names every table a printer needs to print and does not have."""
    missing = [table for table in PRINTING if getattr(printer, table) is None]
    if missing:
        reason = "missing; expected, because the printer is to print a part"
        raise ProfileError(printer.name, [f"[{table}]: {reason}" for table in missing])


def description(path: Path) -> str:
    """The description in a profile file; nothing where it cannot be read."""
    try:
        return str(tomllib.loads(path.read_text(encoding="utf-8")).get("description", ""))
    except (OSError, ValueError):
        return ""
