"""A panorama as a text table: one object per line, y, x, index."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.host_files import a_file_or_a_shells_pipe
from gse.errors import TableError
from gse.values.panorama import MAX_OBJECTS

MAX_FILE_BYTES = 100_000
"""30 lines of text and some comments; anything bigger is another file."""

_SEPARATORS = re.compile(r"[,;\s]+")


def read_panorama_table(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pixels (N, 2) as x, y and index values (N,), brightest first, of a table (LAPAN paper, figure 2-3).

    Columns y, x, index (further columns are not looked at), separated by commas or blanks; ``#`` starts a comment;
    one header line is allowed, and lines of zeros are no objects. TableError names file, line and what was expected.
    """
    rows: list[tuple[float, float, float]] = []
    header_seen = False
    for number, line in enumerate(_read_text(path).splitlines(), start=1):
        fields = [field for field in _SEPARATORS.split(line.partition("#")[0].strip()) if field]
        if not fields:
            continue
        if not rows and not header_seen and fields[0].lower() == "y":
            header_seen = True
            continue
        row = _row(fields, path, number)
        if not any(row):  # a table that is padded to its 30 lines
            continue
        rows.append(row)
        if len(rows) > MAX_OBJECTS:
            raise TableError(
                f"{path}, line {number}: more than {MAX_OBJECTS} objects; a panorama holds up to {MAX_OBJECTS}"
            )
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    table = table[np.argsort(-table[:, 2], kind="stable")]
    return np.ascontiguousarray(table[:, 1::-1]), table[:, 2].copy()


def _read_text(path: Path) -> str:
    try:
        with open(path, encoding="utf-8-sig", opener=a_file_or_a_shells_pipe) as file:
            text = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise TableError(f"cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise TableError(f"{path} is not text: expected a table of y, x, index") from error
    if len(text) > MAX_FILE_BYTES:
        raise TableError(f"{path} is larger than {MAX_FILE_BYTES} bytes: this is not a panorama table")
    return text


def _row(fields: list[str], path: Path, number: int) -> tuple[float, float, float]:
    try:
        y, x, index = (float(field) for field in fields[:3])
    except ValueError:
        raise TableError(f"{path}, line {number}: {' '.join(fields)[:60]!r} is not y, x, index") from None
    if not np.isfinite([y, x, index]).all():
        raise TableError(f"{path}, line {number}: y, x and index must be finite numbers, not {' '.join(fields)[:60]!r}")
    return y, x, index
