"""Search for a camera that the station file states wrongly, while little is identified.

A mirrored image gets that finding alone, unless its focal length is also wrong by more than an identifier tolerates.
Nothing is said where the stated camera fits, and where a built-in identifier under test does not answer with the camera
that was found: then its silence has another reason.

A detector of another size has its objects in a corner of the stated one, or beyond it. Its pixels are of the stated
size, or as much larger as they are fewer (binned). Objects beyond the detector are told even where they are identified.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog, load_catalog, mission_catalog, stars_searched
from gse.identifier import ObjectColumns, make_identifier
from gse.identifier.camera_search import TOLERATED, find_camera
from gse.station.events import StationKind
from gse.station.frame_results import FrameResult
from gse.station.results import Status
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions
from gse.values.instant import NS_PER_S
from gse.values.panorama import Panorama
from gse.values.screen import Screen
from gse.values.text import percent

Said = tuple[StationKind, str]
"""Kind and text of an event."""
_FIRST_AFTER_S = 5.0
"""Time in the data from the first panorama without an answer to the first search; then ten times as long, and so on: a
search that finds nothing takes a second."""
_LATER = 10
_FEWEST_OBJECTS = 7
_ENOUGH_ANSWERS = 5
"""Under a wrong camera one panorama in a hundred is identified all the same, where its stars lie well."""
_FEWEST_BEYOND, _BEYOND_PX = 3, 1.0
"""A panorama shows a larger detector if so many objects lie so far beyond the stated one."""
_USED = 0.9
"""Objects that stay within this share of the rows or columns show a smaller detector, if its camera fits the stars."""
_SHARES = tuple(Fraction(share) for share in ("1/4", "1/3", "1/2", "2/3", "3/4", "4/3", "3/2", "2", "3", "4"))
_EMPTY_EDGE = 1.25
ROUND_PX = 64
"""Sides of a detector that is no simple share of the stated one are mostly multiples of this."""
_CLEARLY_MORE = 1.2
"""What hides a part of the field also keeps all objects in a corner: but then the stated camera names as many stars."""


class CameraWatch:
    """Looks at panoramas until enough are identified, or the true camera is found."""

    def __init__(
        self, camera: Camera, catalog: StarCatalog, subject: IdentifierOptions, screen: Screen | None = None
    ) -> None:
        self._camera, self._catalog, self._subject, self._screen = camera, catalog, subject, screen
        self._first: Panorama | None = None
        self._latest: Panorama | None = None
        self._after_s = _FIRST_AFTER_S
        self._seen = self._answered = self._beyond = 0
        self._reach_px = np.zeros(2)
        self._is_over = self._first_is_searched = False

    def look(self, results: Sequence[FrameResult]) -> list[tuple[int, Said]]:
        """What the stars say of the stated camera, each with the place of its result; mostly nothing."""
        found = []
        for k in range(len(results)):
            if self._is_over:
                break
            result = results[k]
            if said := self._look(result.status, result.panorama):
                found.append((k, said))
        return found

    def _look(self, status: Status, panorama: Panorama) -> Said | None:
        self._seen += 1
        self._answered += status is Status.IDENTIFIED
        if status is not Status.SENSOR_FAULT and len(panorama.xy_px):
            self._reach_px = np.maximum(self._reach_px, panorama.xy_px.max(axis=0))
            beyond = (panorama.xy_px > _sides(self._camera) - 0.5 + _BEYOND_PX).any(axis=1)
            self._beyond += int(beyond.sum()) >= _FEWEST_BEYOND
        self._is_over = self._answered >= min(_ENOUGH_ANSWERS, self._seen)
        if self._is_over:
            return self._larger()
        if status is not Status.NO_MATCH or len(panorama.brightness) < _FEWEST_OBJECTS:
            return None
        self._first, self._latest = self._first or panorama, panorama
        if panorama.utc_ns - self._first.utc_ns < self._after_s * NS_PER_S:
            return None
        self._after_s *= _LATER
        return self.finish()

    def finish(self) -> Said | None:
        """The same at the end of the session, where the latest panoramas were not searched yet."""
        if self._is_over or self._first is None or self._latest is None:
            return None
        is_alone = self._first_is_searched or self._latest is self._first
        panoramas = (self._latest,) if is_alone else (self._first, self._latest)
        self._latest, self._first_is_searched = None, True
        if said := self._of_other_size(panoramas):
            self._is_over = True
            return said
        found = find_camera(panoramas, self._camera, mission_catalog(self._catalog, self._camera, "auto"))
        self._is_over = found is not None
        if found is None or _fits(self._camera, found.camera):
            return None
        if not self._answers(panoramas, found.camera, self._catalog):
            return None
        kind, text = _in_words(self._camera, found.camera)
        if kind is StationKind.WRONG_CAMERA and self._screen is not None:
            text = f"{text}; or {self._screen.of_size(found.camera.focal_length_px / self._camera.focal_length_px)}"
        return kind, text

    def _of_other_size(self, panoramas: Sequence[Panorama]) -> Said | None:
        """A detector of the size that the objects show, if the stars fit it clearly better than the stated one."""
        for camera in _resized(self._camera, self._reach_px):
            source = self._catalog if self._catalog.is_flight else load_catalog(stars=stars_searched(camera))
            catalog = mission_catalog(source, camera)
            found = find_camera(panoramas, camera, catalog)
            if found is None or not self._answers(panoramas, found.camera, source):
                continue
            if camera.principal_point_px != self._camera.principal_point_px:
                stated = find_camera(panoramas, self._camera, catalog)
                if stated is not None and found.stars < _CLEARLY_MORE * stated.stars:
                    continue
            return StationKind.WRONG_DETECTOR, other_size_in_words(self._camera, found.camera, self._reach_px)
        return self._larger()

    def _larger(self) -> Said | None:
        """That objects lie beyond the stated detector, where most panoramas have some there."""
        if 2 * self._beyond <= self._seen:
            return None
        columns, rows = (_side(*one) for one in zip(_sides(self._camera), self._reach_px.tolist(), strict=True))
        size = f"sensor.columns may be {columns}, and sensor.rows {rows}"
        return StationKind.WRONG_DETECTOR, f"{_place_of_objects(self._camera, self._reach_px)}: {size}"

    def _answers(self, panoramas: Sequence[Panorama], camera: Camera, source: StarCatalog) -> bool:
        """Whether the identifier under test answers with a camera; a program of somebody else is not asked again."""
        if self._subject.algorithm == "external":
            return True
        seen = [(camera.directions(panorama.xy_px), panorama.brightness) for panorama in panoramas]
        identifier = make_identifier(self._subject, camera, source)
        return bool(identifier.identify_many(ObjectColumns.from_panoramas(seen)).named.any())


def _sides(camera: Camera) -> NDArray[np.int64]:
    return np.array([camera.columns, camera.rows])


def _side(stated: int, reach_px: float) -> int:
    """The pixels of a side whose objects reach so far: a simple share of the stated ones, or a round number."""
    reach = reach_px + 1
    if _USED * stated <= reach and reach_px <= stated - 0.5 + _BEYOND_PX:
        return stated
    shares = (int(stated * share) for share in _SHARES)
    fitting = (side for side in shares if reach <= side <= _EMPTY_EDGE * reach)
    return next(fitting, math.ceil(reach / ROUND_PX) * ROUND_PX)


def _resized(stated: Camera, reach_px: NDArray[np.float64]) -> Iterator[Camera]:
    """Cameras of the size that objects show, with the pixels of the stated one, and binned; none of the stated size."""
    columns, rows = (_side(*one) for one in zip(_sides(stated).tolist(), reach_px.tolist(), strict=True))
    if (columns, rows) == (stated.columns, stated.rows):
        return
    middle = (columns - 1) / 2, (rows - 1) / 2
    off, off_stated = (
        np.abs(np.subtract(stated.principal_point_px, one)) for one in (middle, (_sides(stated) - 1) / 2)
    )
    principal_point_px = stated.principal_point_px if (off <= off_stated).all() else middle
    same = replace(stated, columns=columns, rows=rows, principal_point_px=principal_point_px)
    yield same
    if columns * stated.rows == rows * stated.columns:
        yield replace(same, focal_length_px=stated.focal_length_px * columns / stated.columns)


def _place_of_objects(stated: Camera, reach_px: NDArray[np.float64]) -> str:
    x, y = reach_px.tolist()
    return (
        f"objects lie at x up to {x:.0f} and y up to {y:.0f} px, and the station file states "
        f"{stated.columns} columns and {stated.rows} rows"
    )


def other_size_in_words(stated: Camera, fitted: Camera, reach_px: NDArray[np.float64]) -> str:
    """Where objects lie at most, x and y (2,), and the camera that the stars fit."""
    parts = [f"sensor.columns: {fitted.columns}", f"sensor.rows: {fitted.rows}"]
    if fitted.principal_point_px != stated.principal_point_px:
        x, y = fitted.principal_point_px
        parts.append(f"sensor.principal_point_px: [{x:g}, {y:g}]")
    if abs(_excess(stated, fitted)) > TOLERATED:
        parts.append(f"sensor.focal_length_px: {fitted.focal_length_px:.1f}")
    if fitted.mirrored != stated.mirrored:
        parts.append(f"sensor.mirrored: {str(fitted.mirrored).lower()}")
    return f"{_place_of_objects(stated, reach_px)}; the stars fit {', '.join(parts)}"


def _excess(stated: Camera, fitted: Camera) -> float:
    return stated.focal_length_px / fitted.focal_length_px - 1


def _fits(stated: Camera, fitted: Camera) -> bool:
    return fitted.mirrored == stated.mirrored and abs(_excess(stated, fitted)) <= TOLERATED


def _in_words(stated: Camera, fitted: Camera) -> Said:
    excess = _excess(stated, fitted)
    length = (
        f"sensor.focal_length_px: {fitted.focal_length_px:.1f}; stated is {stated.focal_length_px:g}, "
        f"{percent(abs(excess), 1)} too {'long' if excess > 0 else 'short'}"
    )
    if fitted.mirrored == stated.mirrored:
        return StationKind.WRONG_CAMERA, f"the stars fit {length}"
    beside = f" and {length}" if abs(excess) > TOLERATED else ""
    return (
        StationKind.MIRRORED,
        f"the image is mirrored: the stars fit sensor.mirrored: {str(fitted.mirrored).lower()}{beside}",
    )
