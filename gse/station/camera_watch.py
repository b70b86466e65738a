"""Search for a camera that the station file states wrongly, while little is identified.

A mirrored image gets that finding alone, unless its focal length is also wrong by more than an identifier tolerates.
Nothing is said where the stated camera fits, and where a built-in identifier under test does not answer with the camera
that was found: then its silence has another reason.
"""

from collections.abc import Sequence

from gse.catalog import StarCatalog, mission_catalog
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


class CameraWatch:
    """Looks at panoramas until enough are identified, or the true camera is found."""

    def __init__(
        self, camera: Camera, catalog: StarCatalog, subject: IdentifierOptions, screen: Screen | None = None
    ) -> None:
        self._camera, self._catalog, self._subject, self._screen = camera, catalog, subject, screen
        self._first: Panorama | None = None
        self._latest: Panorama | None = None
        self._after_s = _FIRST_AFTER_S
        self._seen = self._answered = 0
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
        self._is_over = self._answered >= min(_ENOUGH_ANSWERS, self._seen)
        if self._is_over or status is not Status.NO_MATCH or len(panorama.brightness) < _FEWEST_OBJECTS:
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
        found = find_camera(panoramas, self._camera, mission_catalog(self._catalog, self._camera, "auto"))
        self._is_over = found is not None
        if found is None or _fits(self._camera, found.camera) or not self._answers(panoramas, found.camera):
            return None
        kind, text = _in_words(self._camera, found.camera)
        if kind is StationKind.WRONG_CAMERA and self._screen is not None:
            text = f"{text}; or {self._screen.of_size(found.camera.focal_length_px / self._camera.focal_length_px)}"
        return kind, text

    def _answers(self, panoramas: Sequence[Panorama], camera: Camera) -> bool:
        """Whether the identifier under test answers with a camera; a program of somebody else is not asked again."""
        if self._subject.algorithm == "external":
            return True
        seen = [(camera.directions(panorama.xy_px), panorama.brightness) for panorama in panoramas]
        identifier = make_identifier(self._subject, camera, self._catalog)
        return bool(identifier.identify_many(ObjectColumns.from_panoramas(seen)).named.any())


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
