"""Stars that an identifier left out although the frame shows them.

An identifier that compares distances between objects, as the neighbour technique does, leaves out a star whose distance
from the alpha star differs by more than its tolerance. Air shortens distances by up to a pixel, so that it leaves out
more stars that noise put too far in than others: those that it names lie too far out by 0.05 px on average. Maps and
causes are therefore made from these stars too; the answer under test stays what it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gse.camera import Camera
from gse.catalog import StarCatalog
from gse.constants import ARCSEC_PER_RAD
from gse.identifier import Identification
from gse.station.results import NO_MATCHES, Matches
from gse.truth import SiderealTruth

WITHIN_PX = 4.0
"""Of the place of a star: a false object is as near to one by chance once in a thousand times."""
_BEFORE_AIR_PX = 8.0
"""The same before air and aberration are taken off."""


@dataclass(frozen=True, slots=True, eq=False)
class SolvedFrames:
    """K frames with answers: ``raw`` and ``geometric`` attitudes (K, 3, 3), and the sky of each where it is known."""

    raw: NDArray[np.float64]
    geometric: NDArray[np.float64]
    truth: SiderealTruth | None
    utc_ns: NDArray[np.int64]
    icrs_to_horizon: NDArray[np.float64] | None


class LeftOutStars:
    """Finds objects at the places of stars of a catalogue."""

    def __init__(self, camera: Camera, catalog: StarCatalog) -> None:
        self._pixel_rad, self._catalog = camera.pixel_rad, catalog
        self._places = cKDTree(catalog.icrs)

    def of(
        self, named: Sequence[Identification], directions_sensor: Sequence[NDArray[np.float64]], frames: SolvedFrames
    ) -> list[Matches]:
        """The stars of each of K frames that its answer does not name, with their residuals."""
        rest = [_others(answer, len(objects)) for answer, objects in zip(named, directions_sensor, strict=True)]
        counts = [len(rows) for rows in rest]
        seen = np.concatenate(
            [objects.take(rows, axis=0) for objects, rows in zip(directions_sensor, rest, strict=True)]
        )
        frame_of, objects = np.repeat(np.arange(len(rest)), counts), np.concatenate(rest)
        icrs = np.einsum("nji,nj->ni", frames.raw[frame_of], seen)
        found = self._places.query(icrs, distance_upper_bound=_BEFORE_AIR_PX * self._pixel_rad)
        apart, star = (np.asarray(column) for column in found)
        near = np.flatnonzero(np.isfinite(apart))
        near = near[_free(frame_of[near], star[near], apart[near], named, len(self._catalog))]
        frame_of, objects, star = frame_of[near], objects[near], star[near]
        residuals = self._residuals(seen[near], star, frame_of, frames)
        good = np.hypot(*residuals.T) <= WITHIN_PX * self._pixel_rad
        ends = np.searchsorted(frame_of[good], np.arange(1, len(rest)))
        parts = [np.split(column[good], ends) for column in (objects, star, residuals * ARCSEC_PER_RAD)]
        return [
            Matches(rows, stars, arcsec, self._catalog.name) if len(rows) else NO_MATCHES
            for rows, stars, arcsec in zip(*parts, strict=True)
        ]

    def _residuals(
        self, seen: NDArray[np.float64], star: NDArray[np.int64], frame_of: NDArray[np.int64], frames: SolvedFrames
    ) -> NDArray[np.float64]:
        """Measured less expected directions (N, 2), in radians."""
        stars_icrs = self._catalog.icrs.take(star, axis=0)
        if frames.truth is not None and frames.icrs_to_horizon is not None:
            zenith_sensor = np.einsum("kij,kj->ki", frames.raw, frames.icrs_to_horizon[:, 2])
            seen = frames.truth.unrefracted(seen, zenith_sensor[frame_of])
            stars_icrs = frames.truth.apparent_at(stars_icrs, frames.utc_ns, frames.icrs_to_horizon, frame_of)
        expected = np.einsum("nij,nj->ni", frames.geometric[frame_of], stars_icrs)
        return np.asarray((seen - expected)[:, :2])


def _others(answer: Identification, count: int) -> NDArray[np.int64]:
    """The rows of a panorama that an answer does not name."""
    left = np.ones(count, dtype=np.bool_)
    left[answer.objects] = False
    return np.flatnonzero(left)


def _free(
    frame_of: NDArray[np.int64],
    star: NDArray[np.int64],
    apart: NDArray[np.float64],
    named: Sequence[Identification],
    catalog_stars: int,
) -> NDArray[np.int64]:
    """Which of N pairs have a star that its frame does not name yet; of several objects at one star the nearest."""
    key = frame_of * catalog_stars + star
    taken = np.concatenate([frame * catalog_stars + answer.stars for frame, answer in enumerate(named)])
    order = np.lexsort((apart, key))
    _, first = np.unique(key[order], return_index=True)
    nearest = order[first]
    return np.sort(nearest[~np.isin(key[nearest], taken)])
