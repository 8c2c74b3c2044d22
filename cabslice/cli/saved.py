"""Maps and rows of numbers as files: .csv to read anywhere, .npz for numpy."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from cabslice.arrays import Array
from cabslice.cli.options import Target
from cabslice.files import atomic


def save(
    target: Target, head: Mapping[str, Any], rows: Mapping[str, Array], arrays: Mapping[str, Array] | None = None
) -> None:
    """Write `rows`, arrays (K, ...) by name, or in .npz `arrays` of any shape where they are given.

    csv    "# key: value" lines of `head` (values as JSON), names, then a line per row; an array (K, n) has n columns,
           name_1 to name_n
    npz    the arrays, and `head` as JSON in an array of that name
    Raises OutputError.
    """
    content = _npz(head, rows if arrays is None else arrays) if target.format == "npz" else _csv(head, rows)
    with atomic(target.path, target.overwrite) as file:
        file.write(content)


def _npz(head: Mapping[str, Any], arrays: Mapping[str, Array]) -> bytes:
    whole = io.BytesIO()
    np.savez_compressed(whole, head=np.array(json.dumps(head, sort_keys=True)), **arrays)  # type: ignore[arg-type]
    return whole.getvalue()


def _csv(head: Mapping[str, Any], rows: Mapping[str, Array]) -> bytes:
    flat = {name: column.reshape(len(column), -1) for name, column in rows.items()}
    names = [name if column.shape[1] == 1 else f"{name}_{i + 1}"
             for name, column in flat.items() for i in range(column.shape[1])]
    text = io.StringIO()
    text.writelines(f"# {key}: {json.dumps(value, sort_keys=True)}\n" for key, value in sorted(head.items()))
    text.write(",".join(names) + "\n")
    np.savetxt(text, np.hstack(list(flat.values())), fmt="%.10g", delimiter=",")
    return text.getvalue().encode()
