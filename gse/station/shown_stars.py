"""Stars that frames show: the light of those that an identifier names, and those that it left out.

An identifier that compares distances between objects, as the neighbour technique does, leaves out a star whose distance
from the alpha star differs by more than its tolerance. Air shortens distances by up to a pixel, so that it leaves out
more stars that noise put too far in than others: those that it names lie too far out by 0.05 px on average. Maps and
causes are therefore made from these stars too; the answer under test stays what it is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog
from gse.identifier import Answers, ObjectColumns
from gse.process.jit import compiled
from gse.station.results import Matches, Starlight
from gse.truth import SiderealTruth
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.panorama import Parts

MARGIN_MAG = 1.0
"""Colours, noise and doubles make a star as much brighter than its catalogue magnitude says, or as much fainter."""


def starlights(brightness: NDArray[np.float64], panoramas: Parts, answers: Answers, catalog: StarCatalog) -> Starlight:
    """The light of the stars that an identifier found among the objects of K panoramas, with their brightness (M,).

    Objects that are all of one brightness come from a sensor that sends none: they have no zero point.
    """
    light = Starlight.none(len(answers))
    shown = answers.parts.counts > 0
    if not shown.any():
        return light
    counts, begins = answers.parts.counts[shown], answers.parts.first[:-1][shown]
    magnitude = catalog.magnitude.take(answers.stars)
    index = np.maximum(brightness.take(rows_of(panoramas, answers)), 1.0)
    varies = np.maximum.reduceat(index, begins) > np.minimum.reduceat(index, begins)
    zero_points = np.where(varies, _medians(magnitude + 2.5 * np.log10(index), counts), np.nan)
    fainter_mag = MARGIN_MAG - float(catalog.magnitude[-1])
    light.stars[shown], light.zero_point_mag[shown] = counts, zero_points
    light.limiting_mag[shown] = np.maximum.reduceat(magnitude, begins)
    light.faintest_index[shown] = np.where(varies, 10 ** (0.4 * (zero_points + fainter_mag)), np.inf)
    return light


def rows_of(panoramas: Parts, matches: Answers | Matches) -> NDArray[np.int64]:
    """The rows of all panoramas' objects that matches (M,) name."""
    rows: NDArray[np.int64] = matches.objects + np.repeat(panoramas.first[:-1], matches.parts.counts)
    return rows


def _medians(values: NDArray[np.float64], counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """The median of each part of the values (M,), of these lengths."""
    places = np.arange(counts.max())
    ordered = np.full((len(counts), len(places)), np.nan)
    ordered[places < counts[:, None]] = values
    ordered.sort(axis=1)  # of few each: a sort of all by part and value takes five times as long
    part = np.arange(len(counts))
    medians: NDArray[np.float64] = (ordered[part, (counts - 1) // 2] + ordered[part, counts // 2]) / 2
    return medians


WITHIN_PX = 4.0
"""Largest distance of an object from the place of a star; a false object comes as near by chance once in a thousand
times."""
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
        self._by_z = np.argsort(catalog.icrs[:, 2], kind="stable")
        self._places = np.ascontiguousarray(catalog.icrs[self._by_z])

    def beside(self, objects: ObjectColumns, answers: Answers, frames: SolvedFrames) -> Matches:
        """The stars of each panorama that its answer does not name, with their residuals; none without an answer."""
        named, first = answers.named, objects.parts.first[:-1]
        left = np.repeat(named, objects.parts.counts)
        left[rows_of(objects.parts, answers)] = False
        rows = np.flatnonzero(left)
        panorama_of, place = objects.parts.of_row.take(rows), np.cumsum(named) - 1
        frame_of, seen = place.take(panorama_of), objects.directions_sensor.take(rows, axis=0)
        icrs = np.einsum("nji,nj->ni", frames.raw.take(frame_of, axis=0), seen)
        apart, nearest = _nearest(icrs, self._places, _BEFORE_AIR_PX * self._pixel_rad)
        star = self._by_z[nearest]
        near = np.flatnonzero(np.isfinite(apart))
        if not len(near):  # as of nine frames of ten
            return Matches.none(len(objects))
        taken = answers.parts.of_row * len(self._catalog) + answers.stars
        near = near[_free(panorama_of[near] * len(self._catalog) + star[near], apart[near], taken)]
        residuals = self._residuals(seen[near], star[near], frame_of[near], frames)
        good = np.hypot(*residuals.T) <= WITHIN_PX * self._pixel_rad
        near, residuals_arcsec = near[good], residuals[good] * ARCSEC_PER_RAD
        parts = Parts.of_counts(np.bincount(panorama_of[near], minlength=len(objects)))
        return Matches(parts, rows[near] - first[panorama_of[near]], star[near], residuals_arcsec, self._catalog.name)

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


@compiled
def _nearest(
    seen: NDArray[np.float64], places: NDArray[np.float64], within: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The nearest of places (M, 3), in the order of z, to each direction (N, 3): distance and row; inf where none is.

    Few have nearly the same z. scipy's tree finds them as fast, and takes a quarter of a second to import.
    """
    apart, row = np.full(len(seen), np.inf), np.zeros(len(seen), dtype=np.int64)
    for k in range(len(seen)):
        x, y, z = seen[k, 0], seen[k, 1], seen[k, 2]
        low, high = 0, len(places)
        while low < high:
            middle = (low + high) // 2
            if places[middle, 2] < z - within:
                low = middle + 1
            else:
                high = middle
        least = within * within
        while low < len(places) and places[low, 2] <= z + within:
            square = (places[low, 0] - x) ** 2 + (places[low, 1] - y) ** 2 + (places[low, 2] - z) ** 2
            if square <= least:
                least, row[k] = square, low
                apart[k] = np.sqrt(square)
            low += 1
    return apart, row


def _free(key: NDArray[np.int64], apart: NDArray[np.float64], taken: NDArray[np.int64]) -> NDArray[np.int64]:
    """Which of N pairs have a star that is not taken yet; of several objects at one star the nearest.

    ``key`` (N,) and ``taken`` (M,) stand for a star in a panorama.
    """
    order = np.lexsort((apart, key))
    is_first = np.ones(len(order), dtype=np.bool_)
    is_first[1:] = key[order[1:]] != key[order[:-1]]
    nearest = order[is_first]
    taken = np.sort(taken)
    is_taken = taken.searchsorted(key[nearest], "right") > taken.searchsorted(key[nearest], "left")
    return np.sort(nearest[~is_taken])
