"""The formats motor streams can be written in, by name: for help and for suffixes, without loading any of them."""

from __future__ import annotations

from dataclasses import dataclass

from cabslice.errors import UsageError


@dataclass(frozen=True)
class Name:
    name: str
    suffix: str
    about: str
    module: str                 # in cabslice.motors.formats
    begins: bytes = b""         # first bytes of every file; b"": known by its sidecar


NAMES = {
    row.name: row
    for row in (
        Name("stream", ".stream", "compact binary with index and checksums (default)", "binary", b"\x89STREAM\n"),
        Name("csv", ".csv", "text: a header of '# key: value', then one line a row", "csv",
             b"# cabslice motor stream\n"),
        Name("hermite", ".hermite", "cubic pieces with a stated error bound, 10-100 times smaller than rows", "hermite",
             b"\x89CUBICS\n"),
        Name("twincat-fifo", ".fifo", "TwinCAT NC FIFO axes: LREAL rows x axes, degrees", "twincat_fifo"),
        Name("twincat-csv", ".twincat.csv", "for MC_ExtSetPointGenFeed: position, velocity, acceleration, torque",
             "twincat_csv"),
        Name("halstreamer", ".hal", "LinuxCNC halstreamer: one line a sample", "halstreamer"),
        Name("csp", ".csp", "CiA 402 cyclic synchronous position: int32 counts", "csp"),
        Name("odrive", ".odrive", "ODrive: payloads of Set_Input_Pos, 8 bytes an axis", "odrive"),
        Name("reprap", ".reprap.gcode", "RepRapFirmware G-code with the motors as axes, and its config.g", "reprap",
             b"; cabslice motor angles for RepRapFirmware\n"),
        Name("klipper", ".klipper.gcode", "Klipper G-code with the motors as axes, and its printer.cfg", "klipper",
             b"; cabslice motor angles for Klipper\n"),
        Name("parquet", ".parquet", "Apache Parquet columns (needs pyarrow)", "parquet", b"PAR1"),
    )
}


def name_for(path: str, name: str | None = None) -> Name:
    """The format called `name`, else the one of the longest suffix the path ends in. Raises UsageError listing them."""
    if name is not None:
        if name not in NAMES:
            raise UsageError(f"There is no stream format {name!r}; there are {', '.join(NAMES)}.")
        return NAMES[name]
    fitting = [row for row in NAMES.values() if path.lower().endswith(row.suffix)]
    if fitting:
        return max(fitting, key=lambda row: len(row.suffix))
    listed = ", ".join(f"{row.suffix} ({row.name})" for row in NAMES.values())
    raise UsageError(f"{path}: no stream format has this suffix; there are {listed}, or say --format.")
