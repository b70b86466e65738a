"""Flight catalogues: the star list of a sensor's own memory, as CSV.

Two forms, told apart by the names in their first line; lines that begin with # are comments.

    id,ra_deg,de_deg,magnitude,epoch          a plain list; epoch is the Julian year, the same in all lines
    id,x,y,z,magnitude,n,neighbours           the table of the LAPAN paper, figure 2-5: after n follow n times the
                                              neighbour's id and its distance in whole microradians

In the table ``magnitude`` may be missing. Comments ``# epoch: 2016.0`` and ``# designation: HIP`` say what positions
and numbers are; without them J2000 and numbers of the table's own. A flight catalogue is used as it is: in its own
order, nothing chosen, nothing merged, and with the distances of its table.
"""

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO, TextIOWrapper
from pathlib import Path
from typing import TextIO, get_args

import numpy as np
from numpy.typing import NDArray

from gse.catalog.stars import Designation, Neighbours, StarCatalog
from gse.errors import CatalogError
from gse.values.matrices import product

LIST_COLUMNS = ("id", "ra_deg", "de_deg", "magnitude", "epoch")
TABLE_COLUMNS = ("id", "x", "y", "z", "magnitude", "n", "neighbours")
MOST_STARS = 100_000
MOST_FIELDS = 2_000_000
"""In all lines, a hundred MB of memory; the table of 4,200 stars with a hundred neighbours each has 800,000."""
MOST_BYTES = 32_000_000
_UNIT_WITHIN = 1e-5
"""A unit vector in single precision is one to 1e-7; in five decimals to this."""
_EXACT_WITHIN = 1e-14
"""A vector of double precision is taken to the bit."""
_WHOLE_URAD = 2.0
_COSINE_ERROR = 1.2e-7
"""Error of a cosine in single precision; a distance taken from its arc cosine errs by this over its sine."""


@dataclass(frozen=True, slots=True)
class _Lines:
    """A CSV file: its comments, the names in its first line, and its rows with their line numbers."""

    source: str
    remarks: dict[str, str]
    head_line: int
    names: list[str]
    rows: list[tuple[int, list[str]]]

    def error(self, line: int, text: str) -> CatalogError:
        return CatalogError(f"{self.source}, line {line}: {text}")

    def column(self, name: str) -> NDArray[np.float64]:
        place = self.names.index(name)
        return np.array([self._number(line, row, place, name) for line, row in self.rows], dtype=np.float64)

    def _number(self, line: int, row: Sequence[str], place: int, name: str) -> float:
        text = row[place] if place < len(row) else ""
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.error(line, f"{name} is {text!r:.30}: expected a number")
        return value

    def ids(self) -> NDArray[np.int64]:
        """The numbers of the stars; CatalogError where one is there twice."""
        found: dict[int, int] = {}
        for line, row in self.rows:
            number = self.whole(line, row[0], "id")
            if number in found:
                raise self.error(line, f"star {number} is there twice; first in line {found[number]}")
            found[number] = line
        return np.array(list(found), dtype=np.int64)

    def whole(self, line: int, text: str, name: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = 2**63
        if abs(value) >= 2**63:
            raise self.error(line, f"{name} is {text!r:.30}: expected a whole number")
        return value


def is_flight_catalog(content: bytes) -> bool:
    """Whether a file begins as a flight catalogue does, after its comments."""
    for line in content[:100_000].splitlines():
        if line.strip() and not line.startswith(b"#"):
            return line.replace(b" ", b"").lower().startswith(b"id,")
    return False


def read_flight_catalog(content: bytes, source: str) -> StarCatalog:
    """The stars of a flight catalogue in the order of the file; CatalogError names file and line."""
    lines = _lines(content, source)
    if set(LIST_COLUMNS) <= set(lines.names):
        return _plain_list(lines)
    if tuple(name for name in lines.names if name != "magnitude") == ("id", "x", "y", "z", "n", "neighbours"):
        return _table(lines)
    came, forms = ", ".join(lines.names), f"{','.join(LIST_COLUMNS)}, or {','.join(TABLE_COLUMNS)}"
    raise lines.error(lines.head_line, f"columns are {came:.80}: expected {forms}")


def _lines(content: bytes, source: str) -> _Lines:
    if len(content) > MOST_BYTES:
        raise CatalogError(f"{source} holds more than {MOST_BYTES} bytes: this is not a flight catalogue")
    try:
        content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise CatalogError(f"{source} is not UTF-8 text: byte {error.start}") from error
    remarks: dict[str, str] = {}
    rows: list[tuple[int, list[str]]] = []
    fields = 0
    for number, line in enumerate(TextIOWrapper(BytesIO(content), "utf-8-sig"), 1):
        fields += line.count(",") + 1
        if fields > MOST_FIELDS or len(rows) > MOST_STARS:
            limits = f"at most {MOST_STARS} stars and {MOST_FIELDS} fields are taken"
            raise CatalogError(f"{source}, line {number}: this is not a flight catalogue: {limits}")
        if line.startswith("#"):
            key, _, value = line.lstrip("# ").partition(":")
            remarks.setdefault(key.strip(), value.strip())
        elif line.strip():
            rows.append((number, [field.strip() for field in line.split(",")]))
    if len(rows) < 2:
        raise CatalogError(f"{source} holds no star")
    head_line, names = rows[0]
    return _Lines(source, remarks, head_line, [name.lower() for name in names], rows[1:])


def _plain_list(lines: _Lines) -> StarCatalog:
    for line, row in lines.rows:
        if len(row) != len(lines.names):
            raise lines.error(line, f"{len(row)} fields: expected {len(lines.names)}")
    if lines.names[0] != "id":
        raise lines.error(lines.head_line, "the first column is to be id")
    ids, ra, de = lines.ids(), lines.column("ra_deg"), lines.column("de_deg")
    for (line, _), ra_deg, de_deg in zip(lines.rows, ra.tolist(), de.tolist(), strict=True):
        if not (0 <= ra_deg <= 360 and -90 <= de_deg <= 90):
            raise lines.error(line, f"RA {ra_deg:g}, DE {de_deg:g} deg: expected 0 to 360, and -90 to 90")
    epochs = lines.column("epoch")
    if (other := np.flatnonzero(epochs != epochs[0])).size:
        text = f"epoch is {epochs[other[0]]:g}: expected {epochs[0]:g} as in the first line; bring all to one epoch"
        raise lines.error(lines.rows[int(other[0])][0], text)
    ra, de = np.radians(ra), np.radians(de)
    icrs = np.column_stack([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])
    return _catalog(lines, float(epochs[0]), ids, icrs, lines.column("magnitude"))


def _table(lines: _Lines) -> StarCatalog:
    ids = lines.ids()
    icrs = np.column_stack([lines.column(axis) for axis in "xyz"])
    norms = np.linalg.norm(icrs, axis=1)
    for (line, _), norm in zip(lines.rows, norms.tolist(), strict=True):
        if abs(norm - 1) > _UNIT_WITHIN:
            raise lines.error(line, f"x, y, z has the length {norm:.6f}: expected a unit vector")
    icrs /= np.where(np.abs(norms - 1) < _EXACT_WITHIN, 1.0, norms)[:, None]
    magnitude = lines.column("magnitude") if "magnitude" in lines.names else np.zeros(len(ids))
    try:
        epoch_jyear = float(lines.remarks.get("epoch", "2000"))
    except ValueError:
        raise CatalogError(f"{lines.source}: the comment epoch is not a Julian year") from None
    return _catalog(lines, epoch_jyear, ids, icrs, magnitude, _neighbours(lines, ids, icrs))


def _catalog(
    lines: _Lines,
    epoch_jyear: float,
    ids: NDArray[np.int64],
    icrs: NDArray[np.float64],
    magnitude: NDArray[np.float64],
    neighbours: Neighbours | None = None,
) -> StarCatalog:
    known: dict[str, Designation] = {name: name for name in get_args(Designation)}
    designation = known.get(lines.remarks.get("designation", ""), "flight")
    return StarCatalog(
        f"flight catalogue {Path(lines.source).name}",
        epoch_jyear,
        ids,
        icrs,
        magnitude,
        designation,
        is_flight=True,
        neighbours=neighbours,
    )


def _neighbours(lines: _Lines, ids: NDArray[np.int64], icrs: NDArray[np.float64]) -> Neighbours:
    """The neighbours of each star, nearest first; CatalogError for one that is not in the catalogue or elsewhere."""
    row_of = {number: row for row, number in enumerate(ids.tolist())}
    at = lines.names.index("n")
    first, found, urad = [0], [], []
    for star, (line, row) in enumerate(lines.rows):
        count = lines.whole(line, row[at], "n") if len(row) > at else -1
        fields = row[at + 1 :]
        if len(fields) != 2 * count:
            raise lines.error(line, f"n is {count}: expected {2 * max(count, 0)} fields after it, {len(fields)} came")
        mine: list[tuple[int, int]] = []
        for name, distance in zip(fields[::2], fields[1::2], strict=True):
            neighbour = row_of.get(lines.whole(line, name, "a neighbour"))
            if neighbour is None or neighbour == star:
                what = "the star itself" if neighbour == star else "not in the catalogue"
                raise lines.error(line, f"the neighbour {name} is {what}")
            mine.append((lines.whole(line, distance, "a distance"), neighbour))
        if len({neighbour for _, neighbour in mine}) < len(mine):
            raise lines.error(line, "a neighbour is there twice")
        mine.sort()
        _check_distances(lines, line, ids, icrs, star, mine)
        urad += [distance for distance, _ in mine]
        found += [neighbour for _, neighbour in mine]
        first.append(len(found))
    return Neighbours(np.array(first, np.int64), np.array(found, np.int32), np.array(urad, np.int32))


def _check_distances(
    lines: _Lines,
    line: int,
    ids: NDArray[np.int64],
    icrs: NDArray[np.float64],
    star: int,
    mine: list[tuple[int, int]],
) -> None:
    """CatalogError where a distance is not that of the two stars, as far as single precision can tell."""
    if not mine:
        return
    given = np.array([distance for distance, _ in mine], dtype=np.float64)
    others = icrs[[neighbour for _, neighbour in mine]]
    sine = np.linalg.norm(np.cross(others, icrs[star]), axis=1)
    true = 1e6 * np.arctan2(sine, product(others, icrs[star]))
    wrong = np.abs(given - true) > _WHOLE_URAD + 1e6 * _COSINE_ERROR / np.maximum(sine, 1e-4)
    if wrong.any():
        place = int(np.argmax(wrong))
        raise lines.error(
            line,
            f"the distance to {ids[mine[place][1]]} is {given[place]:.0f} microradians; the places of the two stars "
            f"are {true[place]:.0f} apart",
        )


def write_list(catalog: StarCatalog, out: TextIO) -> None:
    """Write the plain list."""
    writer = csv.writer(out, lineterminator="\n")
    out.write(f"# designation: {catalog.designation}\n")
    writer.writerow(LIST_COLUMNS)
    x, y, z = catalog.icrs.T
    ra_deg, de_deg = np.degrees(np.arctan2(y, x)) % 360, np.degrees(np.arctan2(z, np.hypot(x, y)))
    for number, ra, de, magnitude in zip(catalog.ids, ra_deg, de_deg, catalog.magnitude, strict=True):
        writer.writerow((number, f"{ra:.9f}", f"{de:.9f}", f"{magnitude:.3f}", f"{catalog.epoch_jyear:g}"))


def write_table(catalog: StarCatalog, neighbours: Neighbours, out: TextIO) -> None:
    """Write the table of the LAPAN paper, figure 2-5."""
    writer = csv.writer(out, lineterminator="\n")
    out.write(f"# designation: {catalog.designation}\n# epoch: {catalog.epoch_jyear:g}\n")
    writer.writerow(TABLE_COLUMNS)
    writer.writerows(_table_rows(catalog, neighbours))


def _table_rows(catalog: StarCatalog, neighbours: Neighbours) -> Iterator[list[object]]:
    ids = catalog.ids.tolist()
    for star, (number, place, magnitude) in enumerate(
        zip(ids, catalog.icrs.tolist(), catalog.magnitude.tolist(), strict=True)
    ):
        begin, end = neighbours.first[star], neighbours.first[star + 1]
        row: list[object] = [number, *(f"{value!r}" for value in place), f"{magnitude:.3f}", int(end - begin)]
        for neighbour, urad in zip(
            neighbours.star[begin:end].tolist(), neighbours.urad[begin:end].tolist(), strict=True
        ):
            row += (ids[neighbour], urad)
        yield row
