"""A motor file (or a plan) played by simulate: what is opened, on which robot, and what is said of it."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cabslice.cli.report import Table, Talk
from cabslice.errors import ModelError, UsageError

if TYPE_CHECKING:
    from cabslice.motors.stream import MotorStream
    from cabslice.robot.model import Robot
    from cabslice.simulation.plant import Plant
    from cabslice.toolpath.path import Toolpath


@dataclass(frozen=True)
class Film:
    """What is to be played."""

    title: str
    stream: MotorStream
    printer: Any                # the profile the file was made for
    path: Toolpath | None       # where beads lie, if known


@dataclass(frozen=True)
class Wrong:
    """How the simulated robot differs from the one the file was made for."""

    printer: str | None
    sets: tuple[str, ...]
    modulus: float
    mass: float
    drives: str = "ideal"
    angles_only: bool = False
    encoder_bits: int | None = None

    def drive(self, profile: Any) -> Any:
        """simulation.drives.Drive, or None: ideal. Raises UsageError where options need the cascade."""
        from cabslice.simulation.drives import Drive

        if self.drives == "ideal":
            if self.angles_only or self.encoder_bits:
                raise UsageError("--no-velocity-feed-forward and --encoder-bits go with --drives cascade.")
            return None
        step = 2 * math.pi / 2**self.encoder_bits if self.encoder_bits else 0.0
        gains = profile.drives
        return Drive(gains.position_gain_1_min / 60, 1e3 * gains.velocity_gain_n_m_s, gains.reset_ms * 1e-3,
                     gains.cycle_us * 1e-6, float(not self.angles_only), encoder_step_rad=step)


def opened(file: str, path: str | None) -> Film:
    """Raises ModelError, ProductError, UsageError."""
    from cabslice import store
    from cabslice.motors import formats
    from cabslice.profile.printer import Printer

    if not Path(file).is_file():
        raise ModelError(f"{file}: there is no such file.", file=file)
    if store.is_product(file):
        return _of_plan(file)
    stream = formats.read(file)
    if "printer" not in stream.header:
        raise UsageError(f"{file} does not carry the profile of its printer: export it again.")
    title = stream.header.get("part", {}).get("name", Path(file).name)
    return Film(title, stream, Printer.model_validate(stream.header["printer"]), _path(path))


def _of_plan(file: str) -> Film:
    from cabslice import pipeline, store

    product = store.load(file)[1]
    if not isinstance(product, store.Planned):
        raise UsageError(f"{file} is no motion yet: simulate plays a .plan or a motor file.")
    stream = pipeline.stream_of(product, {}, pipeline.period_of(product))
    return Film(product.origin.part, stream, pipeline.profiles_of(product.origin).printer, product.toolpath)


def _path(file: str | None) -> Toolpath | None:
    from cabslice import store

    if file is None:
        return None
    product = store.load(file)[1]
    if not isinstance(product, (store.Laid, store.Planned)):
        raise UsageError(f"--path {file}: expected a .path or a .plan.")
    return product.toolpath


def robots(film: Film, wrong: Wrong) -> tuple[Robot, Robot, Any]:
    """The robot the file was made for, the one it is played on, and the profile of that."""
    from cabslice.profile import shelf
    from cabslice.robot.model import robot_from_printer

    meant, profile = robot_from_printer(film.printer), film.printer
    if wrong.printer or wrong.sets:
        profile = shelf.load_printer(wrong.printer or film.printer.name, wrong.sets)
    real = robot_from_printer(profile)
    if real.cables != meant.cables or real.winders is None:
        raise UsageError(f"{real.name} cannot play a file for {meant.cables} winders.")
    return meant, replace(real, axial_stiffness=real.axial_stiffness * wrong.modulus, mass=real.mass * wrong.mass,
                          inertia=real.inertia * wrong.mass), profile


def plant_of(film: Film, meant: Robot, real: Robot, profile: Any, damping: str | float) -> Plant:
    """Raises UsageError where the file has no start."""
    import numpy as np

    from cabslice.cli.simulate import damped
    from cabslice.robot.kinematics import lengths
    from cabslice.robot.winder import loaded_length

    header = film.stream.header
    pose, tension = np.array(header["start_pose"]), np.array(header["start_tensions_n"])
    length = lengths(meant, pose[None])
    line = loaded_length(meant, length, np.array(header["start_angles_rad"])[None]) - length
    return damped(real, profile, damping, pose, tension, line)


def tables(found: dict[str, Any]) -> list[str | Table]:
    """The numbers of a run for people."""
    rows = [(name, *_spread(found[key])) for name, key in (
        ("nozzle, from where the file means it to be", "nozzle_error"),
        ("the same beyond the offset of the first layer", "nozzle_error_beyond_offset"),
        ("rounded corners, from the toolpath", "corner_rounding")) if key in found]
    head = ">rms um", ">95 % um", ">largest um"
    blocks: list[str | Table] = [Table(("while laying filament", *head), rows)]
    if "features" in found:
        blocks.append(Table(("feature", *head), [
            (name.replace("_", " "), *_spread(row)) for name, row in found["features"].items()]))
    worst = sorted(found["layers"], key=lambda row: -row["max_mm"])[:5]
    blocks.append(Table(("worst layers", *head), [(str(row["layer"]), *_spread(row)) for row in worst]))
    blocks.append(Table(("worst places", ">x mm", ">y mm", ">z mm", ">at s", ">um", "feature"), [
        (f"layer {row['layer']}", *(f"{x:.2f}" for x in row["xyz_mm"]), f"{row['t_s']:.3f}",
         f"{1e3 * row['distance_mm']:.1f}", row.get("feature", "").replace("_", " ")) for row in found["worst"]]))
    return blocks


def _spread(row: dict[str, Any]) -> tuple[str, str, str]:
    rms, most, largest = (f"{1e3 * row[key]:.2f}" for key in ("rms_mm", "p95_mm", "max_mm"))
    return rms, most, largest


def played(film: Film, meant: Robot, plant: Plant, drive: Any, exact: bool, talk: Talk) -> Any:
    """The run (simulation.prints.Run)."""
    from cabslice.simulation.plant import TOLERANCE
    from cabslice.simulation.prints import FAST, play_stream

    with talk.progress() as tick:
        return play_stream(film.stream, meant, plant, tolerance=TOLERANCE if exact else FAST, drive=drive,
                           tick=lambda row: tick("play", row, film.stream.rows))


def parted(film: Film, meant: Robot, plant: Plant, drive: Any, exact: bool, covariance: str | None, talk: Talk) -> Any:
    """The run and the numbers of its budget."""
    from cabslice.simulation import budget
    from cabslice.simulation.plant import TOLERANCE
    from cabslice.simulation.prints import FAST

    header = film.stream.header
    own = plant_of(film, meant, meant, film.printer, "profile")
    with talk.progress() as tick:
        found = budget.budget(film.stream, meant, own, plant, drive=drive, path=film.path,
                              tolerance=TOLERANCE if exact else FAST,
                              tick=lambda row: tick("play", row, film.stream.rows))
    numbers = budget.numbers(found, header, film.path)
    if covariance:
        names, matrix = _covariance(covariance)
        numbers["calibration_standard_deviation"] = budget.calibration(meant, found.total, names, matrix)
    return found.total, numbers


def _covariance(file: str) -> tuple[list[str], Any]:
    try:
        told = json.loads(Path(file).read_text(encoding="utf-8"))
        return [str(name) for name in told["parameters"]], told["covariance"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ModelError(f"{file}: expected JSON with parameters (names) and covariance (rows of numbers): {error}.",
                         file=file) from None


def budget_table(numbers: dict[str, Any]) -> list[str | Table]:
    """Empty without a budget."""
    found = numbers.get("budget")
    if found is None:
        return []
    rows = [(name, *_spread(row)) for name, row in found["causes"].items()]
    if "calibration_standard_deviation" in found:
        rows.append(("calibration, standard deviation", *_spread(found["calibration_standard_deviation"])))
    return [Table(("error by cause", ">rms um", ">95 % um", ">largest um"), rows),
            f"Each cause switched on alone; their vectors and the interaction add up to the total. Root of the sum of "
            f"squared rms {1e3 * found['root_sum_square_of_rms_mm']:.2f} um, sum of the largest "
            f"{1e3 * found['sum_of_max_mm']:.2f} um."]
