"""Search for the camera of panoramas that cannot be identified: another focal length, or the mirror image.

Trial cameras go outwards from the stated one, in steps that an identifier tolerates. They are tried by the neighbour
technique with few alpha stars, the quickest to refuse: all of them take a quarter of a second for one panorama of 8
deg. It compares distances, which a mirror image has too, and tells such a one by its attitude: so one trial serves
both. The first trial that is not a matter of chance gives the focal length by the distances of its stars, and the stars
are identified again with that.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog, mission_catalog
from gse.catalog.mission import stars_for_field
from gse.identifier.neighbour import NeighbourIdentifier
from gse.identifier.result import Identification, ObjectColumns, Reason, Unidentified
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions
from gse.values.panorama import Panorama

REACH = 0.25
"""Largest error of a focal length that is searched for: more is another lens."""
TOLERATED = 0.002
"""Error of a focal length, to either side, with which panoramas are identified."""
_STEP = 2 * TOLERATED
_ALPHA_RETRIES = 3
_BRIGHTEST = 20
"""Objects of a panorama that a trial looks at. Fainter ones are more often not in the catalogue, and each fits many
stars by chance: with 30 objects a trial takes two to three times as long."""
_A_HIT = 1e-5
"""False match probability of a trial that is looked at more closely."""
_SURE = 1e-9
"""False match probability of an answer with the fitted focal length: some 1000 trials leave one false in a million."""
_FITS = 2
"""The focal length is fitted again with the stars that the first fit brought."""


@dataclass(frozen=True, slots=True)
class FoundCamera:
    """A camera, how many of the panoramas it identifies, and how many of their objects."""

    camera: Camera
    identified: int
    stars: int


def find_camera(
    panoramas: Sequence[Panorama], camera: Camera, catalog: StarCatalog, *, alpha_retries: int = _ALPHA_RETRIES
) -> FoundCamera | None:
    """The camera that identifies some of the panoramas, with another focal length or mirror; None where none does."""
    identifier = NeighbourIdentifier(catalog, camera, IdentifierOptions(alpha_retries=alpha_retries))
    brightest = [_brightest(panorama) for panorama in panoramas]
    for trial in _trials(camera):
        if (hit := _hit(brightest, trial, identifier)) is not None:
            for _ in range(_FITS):
                hit = _refocused(panoramas, hit, identifier)
            if answers := _answers(panoramas, hit, identifier, _SURE):
                return FoundCamera(hit, len(answers), sum(len(answer.stars) for _, answer in answers))
    return None


def _brightest(panorama: Panorama) -> Panorama:
    """The objects of a panorama that a trial looks at, their ranks as brightness: they may all be saturated."""
    xy_px = panorama.xy_px[:_BRIGHTEST]
    return replace(panorama, xy_px=xy_px, brightness=np.arange(len(xy_px), 0.0, -1.0))


_COLUMNS = 1024
"""A picture is searched as if it had so many columns: then the tolerance of 1.5 px holds what its lens distorts."""
_NARROWEST_DEG, _WIDEST_DEG = 5.0, 70.0
_STARS_PER_FIELD = 60
"""Most stars of the catalogue in a mean field: the fewest stars of a mission catalogue are 130 in the widest."""
_BAND = (1 + REACH) / (1 - REACH) * 0.96
"""From the focal length in the middle of a band to the next: bands of +-25 % that overlap."""


def find_unknown_camera(
    panorama: Panorama, columns: int, rows: int, catalog: StarCatalog, *, first_px: float | None = None
) -> Camera | None:
    """The camera of a picture of which nothing is known, with a field of 5 to 70 deg along its rows; None where none
    identifies it.

    ``first_px`` is a focal length to begin with. Then come wide fields before narrow ones, which take longer. The
    brightest object alone is tried as alpha star through all fields, and then more of them: it mostly is a star.
    """
    shrunk = _COLUMNS / columns
    scaled = Panorama(panorama.utc_ns, (panorama.xy_px + 0.5) * shrunk - 0.5, panorama.brightness)
    height = max(round(rows * shrunk), 1)
    bands = list(_bands(None if first_px is None else first_px * shrunk))
    for alpha_retries, focal_px in itertools.product((0, _ALPHA_RETRIES), bands):
        camera = Camera(height, _COLUMNS, focal_px, ((_COLUMNS - 1) / 2, (height - 1) / 2))
        stars = min(stars_for_field(camera), round(_STARS_PER_FIELD * 4 * math.pi / camera.solid_angle_sr))
        found = find_camera([scaled], camera, mission_catalog(catalog, camera, stars), alpha_retries=alpha_retries)
        if found is not None:
            focal_px, mirrored = found.camera.focal_length_px / shrunk, found.camera.mirrored
            return Camera(rows, columns, focal_px, ((columns - 1) / 2, (rows - 1) / 2), mirrored=mirrored)
    return None


def _bands(first_px: float | None) -> Iterator[float]:
    """The focal lengths in the middle of each band, in the columns of a searched picture."""
    if first_px is not None:
        yield first_px
    shortest, longest = (_COLUMNS / 2 / math.tan(math.radians(deg) / 2) for deg in (_WIDEST_DEG, _NARROWEST_DEG))
    focal_px = shortest / (1 - REACH)
    while focal_px * (1 - REACH) < longest:
        yield focal_px
        focal_px *= _BAND


def _trials(camera: Camera) -> Iterator[Camera]:
    for step in range(round(REACH / _STEP) + 1):
        for sign in (1, -1) if step else (1,):
            yield replace(camera, focal_length_px=camera.focal_length_px * (1 + sign * step * _STEP))


def _hit(panoramas: Sequence[Panorama], trial: Camera, identifier: NeighbourIdentifier) -> Camera | None:
    """The trial where it is worth a closer look, or its mirror image where that is."""
    is_mirrored = False
    for _, answer in _asked(panoramas, trial, identifier):
        if isinstance(answer, Unidentified):
            is_mirrored |= answer.reason is Reason.MIRRORED
        elif answer.false_match_probability < _A_HIT:
            return trial
    return replace(trial, mirrored=not trial.mirrored) if is_mirrored else None


def _asked(
    panoramas: Sequence[Panorama], camera: Camera, identifier: NeighbourIdentifier
) -> list[tuple[NDArray[np.float64], Identification | Unidentified]]:
    """Directions (N, 3) of all objects of each panorama, and the answer to it."""
    directions = [camera.directions(panorama.xy_px) for panorama in panoramas]
    objects = ObjectColumns.from_panoramas(
        [(seen, panorama.brightness) for seen, panorama in zip(directions, panoramas, strict=True)]
    )
    return list(zip(directions, identifier.identify_many(objects), strict=True))


def _answers(
    panoramas: Sequence[Panorama], camera: Camera, identifier: NeighbourIdentifier, most_by_chance: float
) -> list[tuple[NDArray[np.float64], Identification]]:
    """Directions (N, 3) of all objects of the panoramas that are identified, and which of them are stars."""
    return [
        (seen, answer)
        for seen, answer in _asked(panoramas, camera, identifier)
        if isinstance(answer, Identification) and answer.false_match_probability < most_by_chance
    ]


def _refocused(panoramas: Sequence[Panorama], camera: Camera, identifier: NeighbourIdentifier) -> Camera:
    """The focal length with which the stars are as far apart as in the catalogue."""
    measured = stated = 0.0
    for seen, answer in _answers(panoramas, camera, identifier, _A_HIT):
        measured += _distances(seen[answer.objects])
        stated += _distances(identifier.catalog.icrs[answer.stars])
    return replace(camera, focal_length_px=camera.focal_length_px * measured / stated) if stated else camera


def _distances(directions: NDArray[np.float64]) -> float:
    """The sum of the distances between all of some directions (N, 3)."""
    return float(np.linalg.norm(directions[:, None] - directions[None], axis=2).sum())
