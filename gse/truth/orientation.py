"""Earth orientation: UT1 - UTC and the pole, from the IERS tables that are installed, frozen around a session.

The tables are those of the package astropy-iers-data, never a download: the series C04 for the past and
``finals2000A.all`` for the last weeks and the predictions. astropy's own reader takes 1.1 s for them; their lines are
of one length and without gaps, one per day, so that the few lines of a session are read by seeking (the test against
astropy compares the values).
"""

import functools
import importlib.metadata
import json
import math
from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import astropy_iers_data  # type: ignore[import-untyped]
import erfa

from gse.errors import TruthError
from gse.instant import NS_PER_DAY, UNIX_EPOCH_MJD, to_text

FIRST_MJD = 41_317
"""1972-01-01, when UTC began to go by leap seconds: there is no truth before."""
_C04_FIRST_MJD, _FINALS_FIRST_MJD = 37_665, 41_684

_Row = tuple[int, float, float, float, float, str]
"""MJD, UT1 - UTC in s, x and y of the pole in arcsec, error of UT1 in s, kind."""
_SCHEMA = "gse.earth-orientation/1"
_MAX_ROWS = 4000
_UT1_LIMIT_S = 0.9
"""UTC is kept within 0.9 s of UT1 by leap seconds (ITU-R TF.460)."""
_UT1_WANDER_S_PER_DAY = 0.001
"""How fast a held UT1 - UTC goes wrong at worst: the length of day has stayed within some 2 ms of 86,400 s since 1980,
and the held value is only trusted to half of that."""


@dataclass(frozen=True, slots=True)
class Orientation:
    """Earth orientation at one instant; ``kind`` is ``measured``, ``predicted`` or ``past the end``."""

    ut1_minus_utc_s: float
    x_pole_rad: float
    y_pole_rad: float
    ut1_error_s: float
    kind: str


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

    @classmethod
    def from_disk(cls, utc_ns: int, days: int = 10) -> Self:
        """The rows within ``days`` of an instant, or the last rows where the instant is past the end.

        TruthError before 1972.
        """
        mjd = _mjd_from_1972(utc_ns)
        finals, c04 = Path(astropy_iers_data.IERS_A_FILE), Path(astropy_iers_data.IERS_B_FILE)
        last = _FINALS_FIRST_MJD + _rows_filled(finals) - 1
        begin, end = max(_C04_FIRST_MJD, min(mjd, last) - days), min(mjd + days, last)
        rows = [_c04_row(line) for line in _lines(c04, begin - _C04_FIRST_MJD, end - begin + 1)]
        begin_finals = begin + len(rows)
        rows += [_finals_row(line) for line in _lines(finals, begin_finals - _FINALS_FIRST_MJD, end - begin_finals + 1)]
        if [row[0] for row in rows] != list(range(begin, end + 1)):
            raise TruthError(f"{c04.parent} holds no IERS tables with one line per day; reinstall astropy-iers-data")
        version = importlib.metadata.version("astropy-iers-data")
        return cls(f"IERS C04 and finals2000A, astropy-iers-data {version}", *zip(*rows, strict=True))

    def to_json(self) -> str:
        """The table as one JSON object; ``from_json`` gives an equal one."""
        return json.dumps({"schema": _SCHEMA, **{name: getattr(self, name) for name in self.__slots__}})

    @classmethod
    def from_json(cls, text: str) -> Self:
        """The table of a JSON text; TruthError where it is none."""
        try:
            document = json.loads(text)
            if document.pop("schema") != _SCHEMA:
                raise ValueError("another schema")
            columns = {name: tuple(document[name]) for name in cls.__slots__ if name != "source"}
            numbers = [value for name, column in columns.items() if name != "kind" for value in column]
            if not 2 <= len(columns["mjd"]) <= _MAX_ROWS or len({len(column) for column in columns.values()}) != 1:
                raise ValueError("columns of different or impossible length")
            if not all(isinstance(value, float | int) and math.isfinite(value) for value in numbers):
                raise ValueError("a value is not a finite number")
            if list(columns["mjd"]) != list(range(columns["mjd"][0], columns["mjd"][0] + len(columns["mjd"]))):
                raise ValueError("days are missing")
            return cls(str(document["source"]), **columns)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            raise TruthError(f"no Earth orientation table of schema {_SCHEMA}: {error}") from error

    def at(self, utc_ns: int) -> Orientation:
        """Earth orientation at an instant: linear between days, held past the ends of the table."""
        mjd = _mjd_from_1972(utc_ns)
        day = mjd + (utc_ns % NS_PER_DAY) / NS_PER_DAY
        left = min(max(bisect_right(self.mjd, day) - 1, 0), len(self.mjd) - 2)
        fraction = min(max(day - self.mjd[left], 0.0), 1.0)
        outside_days = max(self.mjd[0] - day, day - self.mjd[-1], 0.0)
        # UT1 - TAI has no leaps; UT1 - UTC has.
        ut1_minus_tai = [self.ut1_minus_utc_s[row] - tai_minus_utc_s(self.mjd[row]) for row in (left, left + 1)]
        kinds = self.kind[left : left + 2]
        error_s = max(self.ut1_error_s[left : left + 2]) + _UT1_WANDER_S_PER_DAY * outside_days
        return Orientation(
            _between(ut1_minus_tai, fraction) + tai_minus_utc_s(mjd),
            math.radians(_between(self.x_pole_arcsec[left : left + 2], fraction) / 3600),
            math.radians(_between(self.y_pole_arcsec[left : left + 2], fraction) / 3600),
            min(error_s, _UT1_LIMIT_S),
            "past the end" if outside_days else "predicted" if "predicted" in kinds else "measured",
        )

    def warning(self, utc_ns: int) -> str | None:
        """One line for the operator where the table does not reach the instant, else None."""
        here = self.at(utc_ns)
        if here.kind != "past the end":
            return None
        return (
            f"{to_text(utc_ns, 0)} is outside the Earth orientation table ({_day_text(self.mjd[0])} to "
            f"{_day_text(self.mjd[-1])}): UT1 is only known to {here.ut1_error_s:.2g} s = {15 * here.ut1_error_s:.2g} "
            "arcsec; update it with: pip install -U astropy-iers-data"
        )


@functools.lru_cache(maxsize=4096)
def tai_minus_utc_s(mjd: int) -> float:
    """Leap seconds of a day (MJD, 1972 on); of the last known leap second in days to come."""
    year, month, day, _, _ = erfa.ufunc.jd2cal(2_400_000.5, float(mjd))
    # The plain ufunc: erfa.dat would warn of a far year, which the end of the table already shows.
    return float(erfa.ufunc.dat(year, month, day, 0.0)[0])


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


def _lines(path: Path, first: int, count: int) -> list[str]:
    """Some lines of a table of lines of one length, counted after its head; fewer where the table ends."""
    with path.open("rb") as table:
        begin = 0
        while (line := table.readline()).startswith(b"#"):
            begin = table.tell()
        table.seek(begin + max(first, 0) * len(line))
        return table.read(max(count, 0) * len(line)).decode("ascii").splitlines()


def _rows_filled(finals: Path) -> int:
    """Rows that hold a value: those of the far future are blank but for the date."""
    rows = finals.stat().st_size // len((_lines(finals, 0, 1)[0] + "\n").encode())
    while rows > 2 and not _lines(finals, rows - 1, 1)[0][58:68].strip():
        rows -= 1
    return rows


def _c04_row(line: str) -> _Row:
    """One line of C04: columns as in the ReadMe.eopc04 beside it."""
    x, y, ut1, error_s = (float(line[a:b]) for a, b in ((26, 38), (38, 50), (50, 62), (146, 158)))
    return round(float(line[16:26])), ut1, x, y, error_s, "measured"


def _finals_row(line: str) -> _Row:
    """One line of finals2000A: columns as in the ReadMe.finals2000A beside it."""
    x, y, ut1, error_s = (float(line[a:b]) for a, b in ((18, 27), (37, 46), (58, 68), (68, 78)))
    return round(float(line[7:15])), ut1, x, y, error_s, "measured" if line[57] == "I" else "predicted"
