"""Earth orientation: UT1 - UTC and the pole, from the IERS table that is installed, frozen around a night.

The table is ``finals2000A.all`` of the package astropy-iers-data: never a download. astropy's own reader takes 1.1 s
for its 20,000 lines; lines are of one length and days without gaps, so that the few lines of a night are read by
seeking (the test against astropy compares the values). Where the final values (bulletin B) stand, they are taken.
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

FIRST_MJD = 41_684
"""1973-01-02, the first day of the table: there is no truth before."""

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

        TruthError before 1973-01-02.
        """
        mjd = _mjd_from_1973(utc_ns)
        path = Path(astropy_iers_data.IERS_A_FILE)
        with path.open("rb") as table:
            length = len(table.readline())
            last = FIRST_MJD + _count_rows(path, length) - 1
            begin = max(FIRST_MJD, min(mjd - days, last - days))
            table.seek((begin - FIRST_MJD) * length)
            lines = table.read((min(mjd + days, last) - begin + 1) * length).decode("ascii").splitlines()
        rows = [_row(line) for line in lines]
        if [row[0] for row in rows] != list(range(begin, begin + len(rows))):
            raise TruthError(f"{path} is no IERS table finals2000A with one line per day; reinstall astropy-iers-data")
        version = importlib.metadata.version("astropy-iers-data")
        return cls(f"IERS finals2000A, astropy-iers-data {version}", *zip(*rows, strict=True))

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
                raise ValueError("a value is no number")
            if list(columns["mjd"]) != list(range(columns["mjd"][0], columns["mjd"][0] + len(columns["mjd"]))):
                raise ValueError("days are missing")
            return cls(str(document["source"]), **columns)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            raise TruthError(f"no Earth orientation table of schema {_SCHEMA}: {error}") from error

    def at(self, utc_ns: int) -> Orientation:
        """Earth orientation at an instant: linear between days, held past the ends of the table."""
        day = _mjd_from_1973(utc_ns) + (utc_ns % NS_PER_DAY) / NS_PER_DAY
        left = min(max(bisect_right(self.mjd, day) - 1, 0), len(self.mjd) - 2)
        fraction = min(max(day - self.mjd[left], 0.0), 1.0)
        outside_days = max(self.mjd[0] - day, day - self.mjd[-1], 0.0)
        # UT1 - TAI has no leaps; UT1 - UTC has.
        ut1_minus_tai = [self.ut1_minus_utc_s[row] - tai_minus_utc_s(self.mjd[row]) for row in (left, left + 1)]
        kinds = self.kind[left : left + 2]
        error_s = max(self.ut1_error_s[left : left + 2]) + _UT1_WANDER_S_PER_DAY * outside_days
        return Orientation(
            _between(ut1_minus_tai, fraction) + tai_minus_utc_s(math.floor(day)),
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
    # The plain ufunc: erfa.dat would warn of a far year, which the table's own end already tells.
    return float(erfa.ufunc.dat(year, month, day, 0.0)[0])


def _mjd_from_1973(utc_ns: int) -> int:
    mjd = UNIX_EPOCH_MJD + utc_ns // NS_PER_DAY
    if mjd < FIRST_MJD:
        raise TruthError(
            f"no sidereal truth for {to_text(utc_ns, 0)}: the Earth orientation table begins at 1973-01-02; "
            "set the clock that stamps the frames"
        )
    return mjd


def _day_text(mjd: int) -> str:
    return to_text((mjd - UNIX_EPOCH_MJD) * NS_PER_DAY, 0)[:10]


def _between(pair: list[float] | tuple[float, ...], fraction: float) -> float:
    return pair[0] + (pair[1] - pair[0]) * fraction


def _count_rows(path: Path, length: int) -> int:
    """Rows that hold a value: those of the far future are blank but for the date."""
    with path.open("rb") as table:
        rows = path.stat().st_size // length
        while rows > 2:
            table.seek((rows - 1) * length)
            if table.read(length)[58:68].strip():
                break
            rows -= 1
    return rows


def _row(line: str) -> tuple[int, float, float, float, float, str]:
    """One line of finals2000A (columns as in the ReadMe.finals2000A beside it): mjd, UT1 - UTC, pole, error, kind."""
    final = bool(line[134:165].strip())
    x, y, ut1 = (line[134:144], line[144:154], line[154:165]) if final else (line[18:27], line[37:46], line[58:68])
    kind = "measured" if final or line[57] == "I" else "predicted"
    return round(float(line[7:15])), float(ut1), float(x), float(y), float(line[68:78] or 0), kind
