"""Calibration from a session: its panoramas are identified, if need be by search, and the camera is fitted to them.

The identifier is the one that finds the true stars. One that compares distances between objects with the catalogue's,
as the neighbour technique does, leaves out more of the stars that noise puts too far in, because air shortens all
distances: what it names lies too far out, which makes a focal length 3e-5 too long.
"""

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog
from gse.errors import UsageError
from gse.identifier import Identification, Identifier
from gse.identifier.camera_search import REACH, find_camera
from gse.imaging.camera_fit import Calibration, StarField, calibrate
from gse.truth import SiderealTruth
from gse.values.camera import Camera
from gse.values.panorama import Panorama
from gse.values.text import percent

# Hot pixels: objects that stay where they are while the sky moves over the detector.

MIN_SHARE = 0.3
"""A hot pixel is among the brightest 30 in at least this share of the panoramas."""

MIN_PANORAMAS = 20
MIN_MOTION_PX = 8.0
"""By how much the stars must have moved before an object that stands still is called a hot pixel."""


def hot_pixels(
    panoramas_px: Sequence[NDArray[np.float64]], named: Sequence[NDArray[np.int64]], moved_px: float
) -> tuple[tuple[int, int], ...]:
    """Pixels (x, y), sorted, where an object stands in many panoramas and mostly is not a star.

    ``panoramas_px`` holds the objects (N, 2) of each panorama, ``named`` the rows that are stars, and ``moved_px`` is
    how far a star moved from the first to the last. Empty for a sky that stood still and for few panoramas.
    """
    if len(panoramas_px) < MIN_PANORAMAS or moved_px < MIN_MOTION_PX:
        return ()
    seen: Counter[tuple[int, int]] = Counter()
    starlike: Counter[tuple[int, int]] = Counter()
    for xy_px, stars in zip(panoramas_px, named, strict=True):
        pixels = [(int(x), int(y)) for x, y in np.rint(xy_px).tolist()]
        seen.update(set(pixels))
        starlike.update({pixels[row] for row in stars.tolist()})
    enough = MIN_SHARE * len(panoramas_px)
    return tuple(sorted(pixel for pixel, count in seen.items() if count >= enough and starlike[pixel] < count / 2))


MAX_PANORAMAS = 400
"""More do not make it better: neighbouring ones show the same stars on the same pixels."""

_TRIED = 5
_ENOUGH = 0.5
_ROUNDS = 3


class PanoramaSample:
    """Panoramas spread evenly over a session of any length, bounded in number."""

    def __init__(self) -> None:
        self.panoramas: list[Panorama] = []
        self._every = 1
        self._count = 0

    def add(self, panorama: Panorama) -> None:
        """One more panorama of the session."""
        if self._count % self._every == 0:
            self.panoramas.append(panorama)
            if len(self.panoramas) >= 2 * MAX_PANORAMAS:
                self.panoramas = self.panoramas[::2]
                self._every *= 2
        self._count += 1

    def spread(self, count: int) -> list[Panorama]:
        """At most so many of the panoramas, evenly from the whole length."""
        places = np.unique(np.linspace(0, len(self.panoramas) - 1, min(count, len(self.panoramas))).astype(int))
        return [self.panoramas[place] for place in places.tolist()]


@dataclass(frozen=True, slots=True)
class SessionCalibration:
    """A calibration, and the hot pixels seen on the way.

    ``identified_before`` of ``tried`` panoramas were identified with the camera as it was, ``identified_after`` of all
    ``panoramas`` with the fitted one; ``first_scale`` is the factor by which the focal length had to be changed before
    anything was identified (1 where nothing had to).
    """

    calibration: Calibration
    hot_pixels: tuple[tuple[int, int], ...]
    tried: int
    identified_before: int
    panoramas: int
    identified_after: int
    first_scale: float


def calibrate_session(
    sample: PanoramaSample,
    camera: Camera,
    identifier: Identifier,
    truth: SiderealTruth | None,
    *,
    tangential: bool = False,
) -> SessionCalibration:
    """Fit the camera of a session, starting from one whose focal length may be wrong by 25 % or that lacks the mirror.

    Without ``truth`` stars are taken from the catalogue as they are: that leaves refraction (0.03 % of the focal
    length) and aberration (0.01 %) in the result. ``tangential`` distortion is fitted on request. UsageError where
    nothing can be identified.
    """
    panoramas, tried = sample.spread(MAX_PANORAMAS), sample.spread(_TRIED)
    if not panoramas:
        raise UsageError("the session holds no panorama; expected some hundred to calibrate on")
    before = len(_identified(tried, camera, identifier))
    start = camera if before >= _ENOUGH * len(tried) else _search(tried, camera, identifier.catalog)
    found = _identified(panoramas, start, identifier)
    fitted = calibrate(start, [_field(item, identifier, truth) for item in found], tangential=tangential)
    for _ in range(_ROUNDS):
        more = _identified(panoramas, fitted.camera, identifier)
        grown = sum(len(answer.objects) for _, answer in more) > sum(len(answer.objects) for _, answer in found)
        found = more
        fields = [_field(item, identifier, truth) for item in found]
        refitted = calibrate(fitted.camera, fields, anchor=start, tangential=tangential)
        fitted = replace(refitted, before=fitted.before)
        if not grown:
            break
    return SessionCalibration(
        fitted,
        _hot(panoramas, found),
        len(tried),
        before,
        len(panoramas),
        len(found),
        start.focal_length_px / camera.focal_length_px,
    )


_Named = tuple[Panorama, Identification]


def identified(sample: PanoramaSample, camera: Camera, identifier: Identifier) -> tuple[list[_Named], Camera]:
    """The panoramas of a sample with their answers by the camera that their stars fit, and that camera.

    So no star is left out because it stands elsewhere than the stated camera has it. UsageError where nothing answers.
    """
    fitted = calibrate_session(sample, camera, identifier, None, tangential=True).calibration.camera
    return _identified(sample.spread(MAX_PANORAMAS), fitted, identifier), fitted


def star_fields(
    sample: PanoramaSample, camera: Camera, identifier: Identifier, truth: SiderealTruth | None
) -> list[StarField]:
    """The panoramas of a sample that a camera identifies, with the directions in which their stars are seen."""
    found = _identified(sample.spread(MAX_PANORAMAS), camera, identifier)
    return [_field(item, identifier, truth) for item in found]


def _identified(panoramas: list[Panorama], camera: Camera, identifier: Identifier) -> list[_Named]:
    answers = ((item, identifier.identify(camera.directions(item.xy_px), item.brightness)) for item in panoramas)
    return [(item, answer) for item, answer in answers if isinstance(answer, Identification)]


def _search(some: list[Panorama], camera: Camera, catalog: StarCatalog) -> Camera:
    found = find_camera(some, camera, catalog)
    if found is None:
        raise UsageError(
            f"none of {len(some)} panoramas could be identified with a focal length within "
            f"{percent(REACH, 0)} of {camera.focal_length_px:g} px, as it is or mirrored; "
            "check sensor.rows, sensor.columns and sensor.focal_length_px"
        )
    return found.camera


def _field(item: _Named, identifier: Identifier, truth: SiderealTruth | None) -> StarField:
    panorama, answer = item
    stars = identifier.catalog.icrs[answer.stars]
    if truth is not None:
        stars = truth.apparent(stars, panorama.utc_ns)
        stars = truth.refraction.added(stars, truth.icrs_to_horizon(panorama.utc_ns)[2])
    return StarField(panorama.xy_px[answer.objects], stars, answer.stars)


def _hot(panoramas: list[Panorama], found: list[_Named]) -> tuple[tuple[int, int], ...]:
    rows = {id(item): answer.objects for item, answer in found}
    none: NDArray[np.int64] = np.empty(0, dtype=np.int64)
    named = [rows.get(id(item), none) for item in panoramas]
    return hot_pixels([item.xy_px for item in panoramas], named, _moved_px(found))


def _moved_px(found: list[_Named]) -> float:
    """How far the sky moved over the detector: the mean shifts of the stars between two panoramas, added up."""
    path = np.zeros(2)
    for (earlier, one), (later, two) in itertools.pairwise(found):
        stars, first, second = np.intersect1d(one.stars, two.stars, return_indices=True)
        if len(stars):
            path += (later.xy_px[two.objects[second]] - earlier.xy_px[one.objects[first]]).mean(axis=0)
    return float(np.hypot(*path))
