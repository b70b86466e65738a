"""Columns of a session's frames: each is declared here once, with its name, type and meaning.

frames.csv (gse.report.files), Parquet (gse.report), docs/tables.md and the graphs of rerun (gse.view.rerun_columns) are
made from COLUMNS. So a new column is an entry here and a line in the function that fills it.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from gse.station.housekeeping import MODES
from gse.station.results import AnswerCheck, SkyCondition, Status, Subject

STATUSES = tuple(Status)
ANSWER_CHECKS = tuple(AnswerCheck)
SKY_CONDITIONS = tuple(SkyCondition)

UNITS = {
    "mag_per_h": "mag/h",
    "arcsec_per_h": "arcsec/h",
    "arcsec_per_k": "arcsec/K",
    "arcsec_per_s": "arcsec/s",
    "arcsec2": "arcsec²",
    "arcsec": "arcsec",
    "deg": "deg",
    "px2": "px²",
    "px": "px",
    "ns": "ns",
    "us": "us",
    "ms": "ms",
    "s": "s",
    "c": "degC",
    "k": "K",
    "mag": "mag",
    "hpa": "hPa",
    "v": "V",
    "m": "m",
    "ppm": "ppm",
    "jyear": "Julian year",
    "bytes": "bytes",
}
"""Units by the ends of names; the first that fits counts."""
_DECIMALS = {"deg": 7, "us": 1, "s": 6, "degC": 2}
_USUAL_DECIMALS = 3
"""Milliarcseconds, millivolts, milliseconds: below what a sensor shows."""


def unit_of(name: str) -> str:
    """The unit that the end of a column's name states; empty for counts, shares and words."""
    return next((unit for end, unit in UNITS.items() if name.endswith(f"_{end}")), "")


@dataclass(frozen=True, slots=True)
class Column:
    """A column: its name, which ends with its unit, its numpy type, and what it says, in words for docs/tables.md.

    ``decimals`` are those of frames.csv, ``significant`` its digits where these count: a number without a unit states
    one of the two. A column with ``words`` holds places among them. Columns ``of_answer`` are of the subject under
    test; the others are of the panorama, its sky, or truth. The table of sessions gives least, median and greatest of
    a column that is ``ranged``. rerun draws a column with a ``graph`` there, as the ``line`` of that name; columns may
    share a graph, whose name ends with its unit where they have one.
    """

    name: str
    dtype: str
    says: str
    words: tuple[StrEnum, ...] = ()
    decimals: int | None = None
    significant: int | None = None
    of_answer: bool = False
    ranged: bool = False
    graph: str = ""
    line: str = ""

    def __post_init__(self) -> None:
        if np.dtype(self.dtype).kind == "f" and not self.unit and self.decimals is self.significant is None:
            ends = ", ".join(f"_{end}" for end in UNITS)
            raise ValueError(
                f"the name of the column {self.name!r} ends with no known unit; expected one of {ends}. Rename the "
                f"column, or add its unit to UNITS; a share or another pure number states its decimals instead"
            )

    @property
    def unit(self) -> str:
        """The unit that the name states; empty for counts, shares and words."""
        return unit_of(self.name)

    @property
    def is_instant(self) -> bool:
        """Whether the column holds UTC in nanoseconds: an instant for programs that know such a type."""
        return self.name.endswith("utc_ns")

    @property
    def shown_decimals(self) -> int:
        """Digits behind the point in frames.csv."""
        return _DECIMALS.get(self.unit, _USUAL_DECIMALS) if self.decimals is None else self.decimals

    def name_of(self, subject: Subject) -> str:
        """The name in the tables of a session whose frame table holds the answers of ``subject``."""
        if self.of_answer:
            return f"{subject}_{self.name}"
        return self.name.removesuffix("_ns") if self.is_instant else self.name


COLUMNS = (
    # Of the panorama, its answer and truth: filled by FrameResults.rows (gse.station.frame_results).
    Column("utc_ns", "i8", "UTC of mid-exposure"),
    Column("host_utc_ns", "i8", "host clock when the first byte of the frame was read; 0 if not known"),
    Column("time_us", "u8", "time tag of the sensor's own clock"),
    Column("frame_no", "u4", "number of the panorama, as the sensor counts"),
    Column("sequence", "u2", "number of the frame on the wire"),
    Column("status", "u1", "outcome of the identification", words=STATUSES, of_answer=True),
    Column("answer_check", "u1", "the reference identifier's check of the answer", words=ANSWER_CHECKS, of_answer=True),
    Column("objects", "u1", "objects of the panorama", ranged=True),
    Column("matched", "u1", "objects that the answer identified as stars", of_answer=True, ranged=True),
    Column("hot_pixels", "u1", "objects that stay on their pixel while the sky moves", ranged=True),
    Column("exposure_s", "f4", "exposure time", ranged=True),
    Column("temperature_c", "f4", "temperature of the detector", ranged=True, graph="temperature_c", line="detector"),
    Column(
        "false_match_probability",
        "f4",
        "bound on the probability of such an answer to a panorama of random objects",
        significant=3,
        of_answer=True,
    ),
    Column(
        "zero_point_mag",
        "f4",
        "median of catalogue magnitude + 2.5 log10(index value) of the named stars; a cloud of 1 mag lowers it by 1",
        of_answer=True,
        ranged=True,
    ),
    Column(
        "elapsed_us",
        "f4",
        "from objects to RA and DE",
        of_answer=True,
        graph="identification_ms",
        line="identification",
    ),
    Column("ra_deg", "f8", "right ascension that is answered for the boresight, in ICRS", of_answer=True),
    Column("de_deg", "f8", "declination that is answered for the boresight, in ICRS", of_answer=True),
    Column("roll_deg", "f8", "position angle of image up that is answered, from north through east", of_answer=True),
    Column("ra_reference_deg", "f8", "right ascension of the boresight by the reference identifier, in ICRS"),
    Column("de_reference_deg", "f8", "declination of the boresight by the reference identifier, in ICRS"),
    Column("ra_true_deg", "f8", "right ascension of where the mount looked"),
    Column("de_true_deg", "f8", "declination of where the mount looked"),
    Column("roll_true_deg", "f8", "position angle of image up where the mount looked"),
    Column("d_ra_cosde_arcsec", "f8", "error in right ascension, times cos DE", of_answer=True),
    Column("d_de_arcsec", "f8", "error in declination", of_answer=True),
    Column("d_roll_arcsec", "f8", "error in roll", of_answer=True, graph="roll", line="roll"),
    Column(
        "cross_x_arcsec",
        "f8",
        "error of the boresight along columns",
        of_answer=True,
        graph="cross",
        line="x (columns)",
    ),
    Column("cross_y_arcsec", "f8", "error of the boresight along rows", of_answer=True, graph="cross", line="y (rows)"),
    # Of the sky: stars_seen, limiting_mag and false_objects are filled by FrameResults.rows; the others, the same for
    # the frames of 5 s, by gse.station.sky_condition.
    Column(
        "stars_seen",
        "u1",
        "named stars; by the reference identifier where the subject has no answer",
        ranged=True,
        graph="stars",
        line="named",
    ),
    Column(
        "limiting_mag",
        "f4",
        "magnitude of the faintest named star",
        ranged=True,
        graph="stars",
        line="limiting magnitude",
    ),
    Column("sky_condition", "u1", "condition of the sky", words=SKY_CONDITIONS),
    Column("transparency", "f4", "share of the starlight of the session's clearest part", decimals=3, ranged=True),
    Column(
        "stars_expected",
        "f4",
        "catalogue stars in the field, at most as many as a panorama holds",
        decimals=0,
        ranged=True,
    ),
    Column("sun_altitude_deg", "f4", "altitude of the Sun", decimals=2, ranged=True),
    Column("sun_separation_deg", "f4", "angle from the boresight to the Sun", decimals=2, ranged=True),
    Column("moon_altitude_deg", "f4", "altitude of the Moon", decimals=2, ranged=True),
    Column("moon_separation_deg", "f4", "angle from the boresight to the Moon", decimals=2, ranged=True),
    Column(
        "false_objects",
        "u1",
        "objects as bright as stars of the catalogue that are neither star, planet nor hot pixel",
        ranged=True,
    ),
    # Of the latest STATUS frame: filled by gse.station.housekeeping.
    Column("supply_v", "f4", "supply voltage of the latest STATUS frame", ranged=True),
    Column("mode", "u1", "mode of the sensor in the latest STATUS frame", words=MODES),
)
"""One row per panorama, in this order; NaN where a value is missing."""

OWN_COLUMNS = (
    Column("sent", "?", "whether the sensor sent an ATTITUDE frame"),
    Column("acquired", "?", "whether there is an answer in it"),
    Column("ra_deg", "f8", "right ascension that the sensor answers, in ICRS"),
    Column("de_deg", "f8", "declination that the sensor answers, in ICRS"),
    Column("roll_deg", "f8", "roll that the sensor answers, in ICRS"),
    Column("d_ra_cosde_arcsec", "f8", "error in right ascension, times cos DE"),
    Column("d_de_arcsec", "f8", "error in declination"),
    Column("d_roll_arcsec", "f8", "error in roll"),
    Column("cross_x_arcsec", "f8", "error of the boresight along columns"),
    Column("cross_y_arcsec", "f8", "error of the boresight along rows"),
    Column("latency_ms", "f8", "processing time that the sensor states"),
    Column("arrival_ms", "f8", "from mid-exposure to the first byte of the ATTITUDE frame at the host"),
    Column("matched", "u2", "stars that the sensor says it identified"),
)
"""Columns of the sensor's own answers beside panoramas (gse.station.own_answers)."""

FRAME = np.dtype([(column.name, column.dtype) for column in COLUMNS])
"""One row per panorama, columns as declared in COLUMNS."""

_EMPTY = np.array([tuple(np.nan if FRAME[column.name].kind == "f" else 0 for column in COLUMNS)], dtype=FRAME)


def empty_rows(count: int) -> NDArray[np.void]:
    """So many rows of FRAME in which nothing is known: NaN, or 0 where a type has none."""
    return _EMPTY.repeat(count)
