"""The IERS tables: those that are installed, or newer ones that are given as files.

Installed are those of the package astropy-iers-data: the series C04 for the past, ``finals2000A.all`` for the last
weeks and the predictions, and the list of leap seconds. Their lines are of one length and without gaps, one per day, so
that the few lines of a session are read by seeking; astropy's own reader takes 1.1 s. A machine without a network is
brought up to date with files: ``finals2000A.all`` (or ``.daily``, ``.data``), and ``Leap_Second.dat`` or
``leap-seconds.list``.
"""

import functools
import importlib.metadata
import re
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path

import astropy_iers_data  # type: ignore[import-untyped]

from drivers.host_files import only_a_file
from gse.errors import TruthError

C04_FIRST_MJD, FINALS_FIRST_MJD = 37_665, 41_684
MAX_FILE_BYTES = 20_000_000
"""finals2000A.all has 4 MB."""
_NTP_EPOCH_MJD = 15_020
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_EXPIRES = re.compile(r"File expires on\s+(\d{1,2})\s+([A-Za-z]+)\s+(\d{4})")

Row = tuple[int, float, float, float, float, str]
"""MJD, UT1 - UTC in s, x and y of the pole in arcsec, error of UT1 in s, kind (measured or predicted)."""


@dataclass(frozen=True, slots=True)
class LeapSeconds:
    """TAI - UTC from each of the days ``mjd`` on; what comes at ``known_until_mjd`` or later is not announced yet."""

    mjd: tuple[int, ...]
    tai_minus_utc_s: tuple[float, ...]
    known_until_mjd: int

    def at(self, mjd: int) -> float:
        """TAI - UTC of a day; of the last known leap second in days to come."""
        return self.tai_minus_utc_s[max(bisect_right(self.mjd, mjd) - 1, 0)]


@dataclass(frozen=True, slots=True)
class GivenTables:
    """What files gave: rows by MJD that stand before the installed ones, and a list of leap seconds or None."""

    source: str
    rows: dict[int, Row] = field(default_factory=dict)
    leap_seconds: LeapSeconds | None = None


def read_given(paths: Sequence[Path]) -> GivenTables | None:
    """The tables of some files, told apart by their content; None of none. TruthError says what was expected."""
    if not paths:
        return None
    rows: dict[int, Row] = {}
    leap_seconds = None
    for path in paths:
        lines = _text(path).splitlines()
        if _is_finals(lines):
            rows |= _finals_rows(lines, path)
        elif (found := _leap_seconds(lines)) is not None:
            leap_seconds = found
        else:
            raise TruthError(
                f"{path} is not a table of Earth orientation: expected finals2000A (.all, .data, .daily; not .csv or "
                ".xml), Leap_Second.dat or leap-seconds.list, from https://datacenter.iers.org"
            )
    return GivenTables(", ".join(path.name for path in paths), rows, leap_seconds)


def installed_rows(begin_mjd: int, end_mjd: int) -> list[Row]:
    """The installed rows of some days, both ends included; fewer where the tables end."""
    finals, c04 = Path(astropy_iers_data.IERS_A_FILE), Path(astropy_iers_data.IERS_B_FILE)
    end_mjd = min(end_mjd, installed_last_mjd())
    rows = [_c04_row(line) for line in _lines(c04, begin_mjd - C04_FIRST_MJD, end_mjd - begin_mjd + 1)]
    begin = begin_mjd + len(rows)
    rows += [_finals_row(line) for line in _lines(finals, begin - FINALS_FIRST_MJD, end_mjd - begin + 1)]
    if [row[0] for row in rows] != list(range(begin_mjd, begin_mjd + len(rows))):
        raise TruthError(f"{c04.parent} holds no IERS tables with one line per day; reinstall astropy-iers-data")
    return rows


@functools.cache
def installed_last_mjd() -> int:
    """The last day of the installed predictions: rows of the far future are blank but for the date."""
    finals = Path(astropy_iers_data.IERS_A_FILE)
    rows = finals.stat().st_size // len((_lines(finals, 0, 1)[0] + "\n").encode())
    while rows > 2 and not _lines(finals, rows - 1, 1)[0][58:68].strip():
        rows -= 1
    return FINALS_FIRST_MJD + rows - 1


@functools.cache
def installed_leap_seconds() -> LeapSeconds:
    """The list of leap seconds that is installed."""
    path = Path(astropy_iers_data.IERS_LEAP_SECOND_FILE)
    found = _leap_seconds(_text(path).splitlines())
    if found is None:
        raise TruthError(f"{path} is not a list of leap seconds; reinstall astropy-iers-data")
    return found


def installed_source() -> str:
    """What the installed tables are called in a session."""
    return f"IERS C04 and finals2000A, astropy-iers-data {importlib.metadata.version('astropy-iers-data')}"


def _text(path: Path) -> str:
    try:
        with open(path, "rb", opener=only_a_file) as file:
            content = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise TruthError(f"cannot read the Earth orientation file {path}: {error.strerror}") from error
    if len(content) > MAX_FILE_BYTES:
        raise TruthError(f"{path} is larger than {MAX_FILE_BYTES} bytes: this is not a table of Earth orientation")
    return content.decode("latin-1")


def _lines(path: Path, first: int, count: int) -> list[str]:
    """Some lines of a table of lines of one length, counted after its head; fewer where the table ends."""
    with path.open("rb") as table:
        begin = 0
        while (line := table.readline()).startswith(b"#"):
            begin = table.tell()
        table.seek(begin + max(first, 0) * len(line))
        return table.read(max(count, 0) * len(line)).decode("ascii").splitlines()


def _c04_row(line: str) -> Row:
    """One line of C04: columns as in the ReadMe.eopc04 beside it."""
    x, y, ut1, error_s = (float(line[a:b]) for a, b in ((26, 38), (38, 50), (50, 62), (146, 158)))
    return round(float(line[16:26])), ut1, x, y, error_s, "measured"


def _finals_row(line: str) -> Row:
    """One line of finals2000A: columns as in the ReadMe.finals2000A beside it."""
    x, y, ut1, error_s = (float(line[a:b]) for a, b in ((18, 27), (37, 46), (58, 68), (68, 78)))
    return round(float(line[7:15])), ut1, x, y, error_s, "measured" if line[57] == "I" else "predicted"


def _is_finals(lines: list[str]) -> bool:
    return bool(lines) and bool(re.fullmatch(r"[ \d]{6} \d{5}\.00 .{50,}", lines[0]))


def _finals_rows(lines: list[str], path: Path) -> dict[int, Row]:
    rows: dict[int, Row] = {}
    for count, line in enumerate(lines, 1):
        if not line[58:68].strip():
            continue
        try:
            row = _finals_row(line)
        except (ValueError, IndexError):
            raise TruthError(f"{path}, line {count}: no row of finals2000A: {line[:40]!r}; load it down anew") from None
        if not all(abs(value) < 10 for value in row[1:5]):
            raise TruthError(f"{path}, line {count}: UT1 - UTC or the pole is out of range; load it down anew")
        rows[row[0]] = row
    if not rows:
        raise TruthError(f"{path} holds no value of UT1 - UTC; load it down anew")
    return rows


def _leap_seconds(lines: list[str]) -> LeapSeconds | None:
    """The list of Leap_Second.dat (IERS) or leap-seconds.list (NTP); None where it is neither."""
    found: list[tuple[int, float]] = []
    until = None
    for line in lines:
        if line.startswith("#"):
            until = _expiry(line) or until
        elif line.strip():
            try:
                found.append(_leap_second(line.partition("#")[0].split()))
            except (ValueError, IndexError):
                return None
    if until is None or not found or found != sorted(set(found)):
        return None
    return LeapSeconds(tuple(mjd for mjd, _ in found), tuple(value for _, value in found), until)


def _leap_second(words: list[str]) -> tuple[int, float]:
    """A line: MJD, day, month, year, TAI - UTC of the IERS; seconds since 1900, TAI - UTC of NTP."""
    if len(words) == 5:
        mjd, value = round(float(words[0])), float(words[4])
    else:
        seconds, text = words
        mjd, value = _NTP_EPOCH_MJD + int(seconds) // 86_400, float(text)
    if not (41_000 < mjd < 200_000 and 0 < value < 1000):
        raise ValueError
    return mjd, value


def _expiry(line: str) -> int | None:
    """The MJD of the line that says when a list expires."""
    if line.startswith("#@"):
        return _NTP_EPOCH_MJD + int(line[2:]) // 86_400 if line[2:].strip().isdigit() else None
    found = _EXPIRES.search(line)
    if found is None or found[2][:3].lower() not in _MONTHS:
        return None
    try:
        expires = date(int(found[3]), _MONTHS.index(found[2][:3].lower()) + 1, int(found[1]))
    except ValueError:
        return None
    return expires.toordinal() - date(1858, 11, 17).toordinal()
