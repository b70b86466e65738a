"""Search for the camera of panoramas that cannot be identified: another focal length, or the mirror image.

Trial cameras go outwards from the stated one, in steps that an identifier tolerates. They are tried by the neighbour
technique with few alpha stars, the quickest to refuse: all of them take half a second for one panorama. The first trial
that is not a matter of chance gives the focal length by the distances of its stars, and the stars are identified again
with that.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog, mission_catalog
from gse.identifier.neighbour import NeighbourIdentifier
from gse.identifier.result import Identification, ObjectColumns
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions
from gse.values.panorama import Panorama

REACH = 0.25
"""Largest error of a focal length that is searched for: more is another lens."""
TOLERATED = 0.002
"""Error of a focal length, to either side, with which panoramas are identified."""
_STEP = 2 * TOLERATED
_ALPHA_RETRIES = 3
_A_HIT = 1e-5
"""False match probability of a trial that is looked at more closely."""
_SURE = 1e-9
"""False match probability of an answer with the fitted focal length: some 1000 trials leave one false in a million."""
_FITS = 2
"""The focal length is fitted again with the stars that the first fit brought."""


@dataclass(frozen=True, slots=True)
class FoundCamera:
    """A camera, and how many of the panoramas it identifies."""

    camera: Camera
    identified: int


def find_camera(panoramas: Sequence[Panorama], camera: Camera, catalog: StarCatalog) -> FoundCamera | None:
    """The camera that identifies some of the panoramas, with another focal length or mirror; None where none does."""
    identifier = NeighbourIdentifier(catalog, camera, IdentifierOptions(alpha_retries=_ALPHA_RETRIES))
    for trial in _trials(camera):
        if _answers(panoramas, trial, identifier, _A_HIT):
            for _ in range(_FITS):
                trial = _refocused(panoramas, trial, identifier)
            if answers := _answers(panoramas, trial, identifier, _SURE):
                return FoundCamera(trial, len(answers))
    return None


_COLUMNS = 1024
"""A picture is searched as if it had so many columns: then the tolerance of 1.5 px holds what its lens distorts."""
_NARROWEST_DEG, _WIDEST_DEG = 5.0, 70.0
_BAND = (1 + REACH) / (1 - REACH) * 0.96
"""From the focal length in the middle of a band to the next: bands of +-25 % that overlap."""


def find_unknown_camera(
    panorama: Panorama, columns: int, rows: int, catalog: StarCatalog, *, first_px: float | None = None
) -> Camera | None:
    """The camera of a picture of which nothing is known, with a field of 5 to 70 deg along its rows; None where none
    identifies it.

    ``first_px`` is a focal length to begin with. Then come wide fields before narrow ones, which take longer.
    """
    shrunk = _COLUMNS / columns
    scaled = Panorama(panorama.utc_ns, (panorama.xy_px + 0.5) * shrunk - 0.5, panorama.brightness)
    height = max(round(rows * shrunk), 1)
    for focal_px in _bands(None if first_px is None else first_px * shrunk):
        camera = Camera(height, _COLUMNS, focal_px, ((_COLUMNS - 1) / 2, (height - 1) / 2))
        found = find_camera([scaled], camera, mission_catalog(catalog, camera))
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
            scaled = replace(camera, focal_length_px=camera.focal_length_px * (1 + sign * step * _STEP))
            yield scaled
            yield replace(scaled, mirrored=not camera.mirrored)


_Answer = tuple[NDArray[np.float64], Identification]
"""Directions (N, 3) of all objects of a panorama, and which of them are stars."""


def _answers(
    panoramas: Sequence[Panorama], camera: Camera, identifier: NeighbourIdentifier, most_by_chance: float
) -> list[_Answer]:
    directions = [camera.directions(panorama.xy_px) for panorama in panoramas]
    objects = ObjectColumns.from_panoramas(
        [(seen, panorama.brightness) for seen, panorama in zip(directions, panoramas, strict=True)]
    )
    return [
        (seen, answer)
        for seen, answer in zip(directions, identifier.identify_many(objects), strict=True)
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
