"""Earth orientation: UT1 - UTC, the pole and leap seconds, by the IERS tables, frozen around a session.

Past the end of the tables the last values are held; how wrong they may be grows by the day, and is an event and a
term of the uncertainty budget.

Installed are the tables of the package astropy-iers-data: the series C04 for the past, ``finals2000A.all`` for the last
weeks and the predictions, and the list of leap seconds. Their lines are of one length and without gaps, one per day, so
that the few lines of a session are read by seeking; astropy's own reader takes 1.1 s. A machine without a network is
brought up to date with files: ``finals2000A.all`` (or ``.daily``, ``.data``), and ``Leap_Second.dat`` or
``leap-seconds.list``.
"""

import functools
import importlib.metadata
import json
import math
import re
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any, Self

import astropy_iers_data  # type: ignore[import-untyped]

from drivers.host_files import only_a_file
from drivers.outside_text import plain_line
from gse.errors import TruthError
from gse.values.instant import NS_PER_DAY, UNIX_EPOCH_MJD, to_text

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
        elif (found := _listed_leap_seconds(lines)) is not None:
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
    found = _listed_leap_seconds(_text(path).splitlines())
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


def _listed_leap_seconds(lines: list[str]) -> LeapSeconds | None:
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


FIRST_MJD = 41_317
FIRST_NS = (FIRST_MJD - UNIX_EPOCH_MJD) * NS_PER_DAY
"""1972-01-01, when UTC began to go by leap seconds: there is no truth before."""

_SCHEMA = "gse.earth-orientation/1"
_COLUMNS = ("mjd", "ut1_minus_utc_s", "x_pole_arcsec", "y_pole_arcsec", "ut1_error_s", "kind")
_MAX_ROWS = 4000
_MAX_LEAP_SECONDS = 400
_MAX_VALUE = 1e6
"""Largest value in a table, whether days (MJD), seconds or arcseconds."""
_UT1_LIMIT_S = 0.9
"""UTC is kept within 0.9 s of UT1 by leap seconds (ITU-R TF.460)."""
_UT1_WANDER_S_PER_DAY = 0.001
"""How fast a held UT1 - UTC goes wrong at worst: the length of day has stayed within some 2 ms of 86,400 s since 1980,
and the held value is only trusted to half of that."""
_POLE_ERROR_ARCSEC = {"measured": 0.0005, "predicted": 0.02}
"""IERS Bulletin A, section predictions: 0.00068 d^0.8 arcsec, up to a year."""
_POLE_WANDER_ARCSEC_PER_DAY = 0.004
"""How fast a held pole goes wrong at worst: it goes round 0.3 arcsec in 433 days and about as much in a year."""
_POLE_LIMIT_ARCSEC = 0.6
UPDATE = (
    "update it with: pip install -U astropy-iers-data, or give newer files with --earth-orientation finals2000A.all"
)


@dataclass(frozen=True, slots=True)
class Orientation:
    """Earth orientation at one instant; ``kind`` is ``measured``, ``predicted`` or ``past the end``.

    ``leap_error_s`` is what a leap second that is not in the list adds to the error of UT1 - UTC: 0 where the list
    makes an announcement for the day.
    """

    ut1_minus_utc_s: float
    x_pole_rad: float
    y_pole_rad: float
    ut1_error_s: float
    kind: str
    pole_error_arcsec: float
    tai_minus_utc_s: float
    leap_error_s: float


@dataclass(frozen=True, slots=True)
class EarthOrientation:
    """A table of Earth orientation, one row per day at 0h UTC; compared by value, kept in a session as JSON."""

    source: str
    mjd: tuple[int, ...]
    ut1_minus_utc_s: tuple[float, ...]
    x_pole_arcsec: tuple[float, ...]
    y_pole_arcsec: tuple[float, ...]
    ut1_error_s: tuple[float, ...]
    kind: tuple[str, ...]
    leap_seconds: LeapSeconds

    @classmethod
    def from_disk(cls, utc_ns: int, days: int = 10, given: GivenTables | None = None) -> Self:
        """The rows within ``days`` of an instant, or the last rows where the instant is past the end.

        Rows of ``given`` files stand before those that are installed. TruthError before 1972.
        """
        mjd = _mjd_from_1972(utc_ns)
        newer = given.rows if given else {}
        last = max(installed_last_mjd(), *newer) if newer else installed_last_mjd()
        begin, end = max(C04_FIRST_MJD, min(mjd, last) - days), min(mjd + days, last)
        rows = {row[0]: row for row in installed_rows(begin, end)}
        rows |= {day: newer[day] for day in range(begin, end + 1) if day in newer}
        if sorted(rows) != list(range(begin, end + 1)):
            raise TruthError(
                f"the Earth orientation files leave a gap before {_day_text(last)}; give finals2000A.all, not .daily"
            )
        leap_seconds = given.leap_seconds if given and given.leap_seconds else installed_leap_seconds()
        source = installed_source() + (f", and {given.source}" if given else "")
        columns = dict(zip(_COLUMNS, zip(*(rows[day] for day in sorted(rows)), strict=True), strict=True))
        return cls(source, **columns, leap_seconds=leap_seconds)

    def to_json(self) -> str:
        """The table as one JSON object; ``from_json`` gives an equal one."""
        leap = {name: getattr(self.leap_seconds, name) for name in self.leap_seconds.__slots__}
        columns = {name: getattr(self, name) for name in ("source", *_COLUMNS)}
        return json.dumps({"schema": _SCHEMA, **columns, "leap_seconds": leap})

    @classmethod
    def from_json(cls, text: str) -> Self:
        """The table of a JSON text; TruthError where it is none. Without leap seconds (0.1.0) the installed serve."""
        try:
            document = json.loads(text)
            if document.pop("schema") != _SCHEMA:
                raise ValueError("another schema")
            columns = {name: tuple(document[name]) for name in _COLUMNS}
            _check_columns(columns)
            leap = document.get("leap_seconds")
            leap_seconds = installed_leap_seconds() if leap is None else _leap_seconds(leap)
            return cls(plain_line(str(document["source"])), **columns, leap_seconds=leap_seconds)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError, OverflowError) as error:
            raise TruthError(f"no Earth orientation table of schema {_SCHEMA}: {error}") from error

    def at(self, utc_ns: int) -> Orientation:
        """Earth orientation at an instant: linear between days, held past the ends of the table."""
        mjd = _mjd_from_1972(utc_ns)
        day = mjd + (utc_ns % NS_PER_DAY) / NS_PER_DAY
        left = min(max(bisect_right(self.mjd, day) - 1, 0), len(self.mjd) - 2)
        fraction = min(max(day - self.mjd[left], 0.0), 1.0)
        outside_days = max(self.mjd[0] - day, day - self.mjd[-1], 0.0)
        # UT1 - TAI has no leaps; UT1 - UTC has.
        ut1_minus_tai = [self.ut1_minus_utc_s[row] - self.leap_seconds.at(self.mjd[row]) for row in (left, left + 1)]
        kind = "predicted" if "predicted" in self.kind[left : left + 2] else "measured"
        tai_minus_utc_s = self.leap_seconds.at(mjd)
        ut1_minus_utc_s = _between(ut1_minus_tai, fraction) + tai_minus_utc_s
        error_s = max(self.ut1_error_s[left : left + 2]) + _UT1_WANDER_S_PER_DAY * outside_days
        pole_arcsec = _POLE_ERROR_ARCSEC[kind] + _POLE_WANDER_ARCSEC_PER_DAY * outside_days
        most_s = _UT1_LIMIT_S + abs(ut1_minus_utc_s)
        announced = mjd < self.leap_seconds.known_until_mjd
        return Orientation(
            ut1_minus_utc_s,
            math.radians(_between(self.x_pole_arcsec[left : left + 2], fraction) / 3600),
            math.radians(_between(self.y_pole_arcsec[left : left + 2], fraction) / 3600),
            min(error_s, most_s),
            "past the end" if outside_days else kind,
            min(pole_arcsec, _POLE_LIMIT_ARCSEC),
            tai_minus_utc_s,
            0.0 if announced else min(1.0, max(most_s - error_s, 0.0)),
        )

    def warning(self, utc_ns: int) -> str | None:
        """One line for the operator where the tables do not reach the instant, else None."""
        here, when = self.at(utc_ns), to_text(utc_ns, 0)
        told = []
        if here.kind == "past the end":
            told.append(
                f"{when} is outside the Earth orientation table ({_day_text(self.mjd[0])} to "
                f"{_day_text(self.mjd[-1])}): UT1 is only known to {here.ut1_error_s:.2g} s = "
                f"{15 * here.ut1_error_s:.2g} arcsec"
            )
        if _mjd_from_1972(utc_ns) >= self.leap_seconds.known_until_mjd:
            until = _day_text(self.leap_seconds.known_until_mjd)
            told.append(f"leap seconds are only announced until {until}: one that is missing is 15 arcsec")
        return "; ".join([*told, UPDATE]) if told else None


def _check_columns(columns: dict[str, Any]) -> None:
    numbers = [value for name, column in columns.items() if name != "kind" for value in column]
    if not 2 <= len(columns["mjd"]) <= _MAX_ROWS or len({len(column) for column in columns.values()}) != 1:
        raise ValueError("columns of different or impossible length")
    if not all(isinstance(value, float | int) and math.isfinite(value) for value in numbers):
        raise ValueError("a value is not a finite number")
    if not all(abs(value) < _MAX_VALUE for value in numbers):
        raise ValueError("a value is out of order")
    if not all(kind in ("measured", "predicted") for kind in columns["kind"]):
        raise ValueError("a kind of value that is not known")
    if list(columns["mjd"]) != list(range(columns["mjd"][0], columns["mjd"][0] + len(columns["mjd"]))):
        raise ValueError("days are missing")


def _leap_seconds(document: Any) -> LeapSeconds:
    mjd, values = document["mjd"], document["tai_minus_utc_s"]
    until = document["known_until_mjd"]
    if not 1 <= len(mjd) == len(values) <= _MAX_LEAP_SECONDS or list(mjd) != sorted(set(mjd)):
        raise ValueError("leap seconds of impossible length or order")
    if not all(isinstance(value, float | int) and math.isfinite(value) for value in (*mjd, *values, until)):
        raise ValueError("a leap second is not a number")
    return LeapSeconds(tuple(mjd), tuple(values), int(until))


def _mjd_from_1972(utc_ns: int) -> int:
    mjd = UNIX_EPOCH_MJD + utc_ns // NS_PER_DAY
    if mjd < FIRST_MJD:
        raise TruthError(
            f"no sidereal truth for {to_text(utc_ns, 0)}: the Earth orientation table begins at 1972-01-01; "
            "set the clock that stamps the frames"
        )
    return mjd


def _day_text(mjd: int) -> str:
    return to_text((mjd - UNIX_EPOCH_MJD) * NS_PER_DAY, 0)[:10]


def _between(pair: list[float] | tuple[float, ...], fraction: float) -> float:
    return pair[0] + (pair[1] - pair[0]) * fraction
