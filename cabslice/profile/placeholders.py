"""Names in braces that stand for figures of a print, in the lines a printer wants before and after its G-code."""

from __future__ import annotations

import re
from collections.abc import Mapping

PLACEHOLDERS = {
    "first_nozzle_c": "nozzle temperature the print begins with, degC",
    "first_bed_c": "bed temperature the print begins with, degC",
    "layers": "number of layers",
    "height_mm": "top of the last layer, mm",
    "filament_mm": "filament used, mm",
    "print_s": "time at the speeds asked for, s",
    "min_x_mm": "least x of any bead, mm", "max_x_mm": "greatest x of any bead, mm",
    "min_y_mm": "least y of any bead, mm", "max_y_mm": "greatest y of any bead, mm",
    "nozzle_mm": "bore of the nozzle, mm",
    "layer_mm": "layer height, mm",
    "printer": "name of the printer", "material": "name of the material", "process": "name of the process",
}
NAMED = re.compile(r"\{([a-z_0-9]+)\}")


def strangers(text: str) -> list[str]:
    """Names in the text that stand for nothing."""
    return [name for name in NAMED.findall(text) if name not in PLACEHOLDERS]


def filled(text: str, values: Mapping[str, str]) -> list[str]:
    """The lines of a text with all placeholders replaced."""
    return [NAMED.sub(lambda match: values[match[1]], line.rstrip()) for line in text.strip().splitlines()]
