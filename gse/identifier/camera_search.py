"""Search for the camera of panoramas that cannot be identified: another focal length, or the mirror image.

Trial cameras go outwards from the stated one, in steps that an identifier tolerates. They are tried by the neighbour
technique with few alpha stars, the quickest to refuse: all of them take half a second for one panorama. The first trial
that is not a matter of chance gives the focal length by the distances of its stars, and the stars are identified again
with that.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog
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
