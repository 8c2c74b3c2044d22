"""One job from its part to its motor file, and what is to be told of it; nothing that happens to it is raised.

A record is JSON: name, part, printer, profiles, verdict ("made" or why not), exit_code, and what there is of sentence,
findings, numbers, margins, repairs, warnings, files. It depends on the job alone: no clock, worker or folder is in it.
"""

from __future__ import annotations

import hashlib
import traceback
from pathlib import Path
from typing import Any

from cabslice import __version__, errors, pipeline, store
from cabslice.batch.jobs import Job, Wanted
from cabslice.errors import CabsliceError, ModelError, UsageError
from cabslice.motors.formats import FORMATS, format_of
from cabslice.motors.names import NAMES
from cabslice.pipeline import Placed, Profiles
from cabslice.profile import shelf
from cabslice.profile.material import Material
from cabslice.profile.printer import Printer
from cabslice.profile.process import Process
from cabslice.store import Product

Record = dict[str, Any]
VERDICTS = {
    errors.EXIT_OK: "made", errors.EXIT_USAGE: "wrong", errors.EXIT_INPUT: "wrong",
    errors.EXIT_IMPOSSIBLE: "impossible", errors.EXIT_OUTPUT: "unwritten", errors.EXIT_BUG: "failed",
}
NUMBERS = ("layers", "duration_s", "filament_mm", "mass_g", "rows")
FINDINGS = 8           # of a job, at most


def make(job: Job, folder: str, resume: bool = False) -> tuple[Record, str]:
    """The record of a job, and the traceback where it found a bug ("" else). Its files are written into `folder`.

    What stands under their names is replaced: whoever asks has seen to it that this is wanted.
    """
    try:
        return _made(job, Path(folder), resume), ""
    except CabsliceError as error:
        return _refused(job, error), ""
    except Exception as error:
        return failed(job, f"{type(error).__name__}: {error}"), traceback.format_exc()


def _made(job: Job, folder: Path, resume: bool) -> Record:
    if job.version != __version__:
        raise UsageError(f"This worker has cabslice {__version__}, the job is for {job.version}: install the same.")
    planned, verdict = pipeline.to_plan(begin(job))
    period = job.period_ms / 1e3 if job.period_ms else pipeline.period_of(planned)
    stream = pipeline.to_stream(planned, verdict, period_s=period)
    path = target(job, folder)
    found = pipeline.save_stream(stream, path, job.format, overwrite=True, resume=resume)
    return {
        **about(job), "verdict": "made", "exit_code": errors.EXIT_OK, "margins": dict(verdict.margins),
        "numbers": {key: found[key] for key in NUMBERS if key in found}, "repairs": list(planned.origin.repairs),
        "warnings": list(planned.origin.warnings), "files": [hashed(file) for file in files(job, folder)],
    }


def begin(job: Job) -> Placed | Product:
    """The part on the bed, the path in G-code, or a product, with the profiles of the job."""
    profiles = _profiles(job)
    if format_of(job.part) is not None:
        raise ModelError(f"{Path(job.part).name} is a motor file already.", file=Path(job.part).name)
    if store.is_product(job.part):
        product = store.load(job.part)[1]
        if job.profiles[0] == product.origin.printer or isinstance(product, store.Planned):
            return product
        return pipeline.for_printer(product, profiles.printer)
    if Path(job.part).suffix.lower() in pipeline.GCODE:
        return pipeline.read_gcode(job.part, profiles)
    return pipeline.read(job.part, profiles, job.placement, blockers=job.blockers, enforcers=job.enforcers)


def _profiles(job: Job) -> Profiles:
    printer, material, process = job.profiles
    return Profiles(Printer.model_validate_json(printer), Material.model_validate_json(material),
                    Process.model_validate_json(process))


def target(job: Job, folder: Path) -> Path:
    return folder / f"{job.name}{NAMES[job.format].suffix}"


def files(job: Job, folder: Path) -> list[Path]:
    return FORMATS[job.format].files(target(job, folder))


def hashed(path: Path) -> dict[str, Any]:
    """Name, size and SHA-256 of a file. OSError where it cannot be read."""
    with open(path, "rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"file": path.name, "bytes": path.stat().st_size, "sha256": digest}


# ---- records

def about(job: Job) -> Record:
    models = dict(zip(("printer", "material", "process"), vars(_profiles(job)).values(), strict=True))
    profiles = {kind: {"name": model.name, "sha256": shelf.profile_hash(model)} for kind, model in models.items()}
    part = {"file": Path(job.part).name, "sha256": job.sha256}
    return {"name": job.name, "part": part, "printer": profiles["printer"]["name"], "profiles": profiles}


def _refused(job: Job, error: CabsliceError) -> Record:
    return about(job) | refusal(error, job.part)


def refusal(error: CabsliceError, part: str) -> Record:
    """What a record says of an error; the folder of the part is nobody's business."""
    folder = str(Path(part).parent)
    sentence = error.sentence.replace(f"{folder}/", "") if folder != "." else error.sentence
    findings = [finding.as_dict() for finding in getattr(error, "findings", ())]
    told: Record = {"verdict": VERDICTS.get(error.exit_code, "failed"), "exit_code": error.exit_code,
                    "sentence": sentence}
    return told | ({"findings": findings[:FINDINGS], "findings_in_all": len(findings)} if findings else {})


def not_begun(wanted: Wanted, error: CabsliceError) -> Record:
    part = {"file": Path(wanted.part).name, "sha256": None}
    return {"name": wanted.name, "part": part, "printer": Path(wanted.printer).stem, "profiles": None,
            **refusal(error, wanted.part)}


def failed(job: Job, sentence: str) -> Record:
    """A job that found a bug, or took its worker with it."""
    return about(job) | {"verdict": "failed", "exit_code": errors.EXIT_BUG, "sentence": sentence}
