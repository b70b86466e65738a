"""The stars of a scene: the catalogue's, with what the scene leaves out, moves and adds."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog, load_catalog
from gse.simulator.scenario import SceneSection
from gse.values.constants import ARCSEC_RAD
from gse.values.instant import to_julian_year


def scene_catalog(scene: SceneSection, utc_ns: int, faintest_magnitude: float) -> StarCatalog:
    """The catalogue's stars to a magnitude as the scene shows them, at the date of ``utc_ns``.

    The same star is dropped, or off by the same, whatever else is shown: its draw depends on its number alone.
    """
    catalog = load_catalog(faintest_magnitude=faintest_magnitude).at_epoch(to_julian_year(utc_ns))
    if not scene.dropped and not scene.noise_arcsec:
        return catalog
    draws = np.array([_draw(scene.seed, number) for number in catalog.ids.tolist()])
    kept = draws[:, 0] >= scene.dropped
    off = draws[kept, 1:4] * scene.noise_arcsec * ARCSEC_RAD
    stars = catalog.rows(np.flatnonzero(kept))
    moved = stars.icrs + off - (off * stars.icrs).sum(axis=1)[:, None] * stars.icrs
    return replace(stars, icrs=moved / np.linalg.norm(moved, axis=1)[:, None])


def _draw(seed: int, star: int) -> NDArray[np.float64]:
    """A uniform number and three normal ones of a star."""
    random = np.random.default_rng((seed, star & (1 << 63) - 1))
    return np.concatenate([random.random(1), random.normal(size=3)])


def added_objects(scene: SceneSection) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions (N, 3) and magnitudes (N,) of what the scene adds among the stars."""
    ra, de = np.radians([(item.ra_deg, item.de_deg) for item in scene.objects]).reshape(-1, 2).T
    directions = np.column_stack([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])
    return directions, np.array([item.magnitude for item in scene.objects])


def false_places(scene: SceneSection, step: int, columns: int, rows: int) -> NDArray[np.float64]:
    """Pixels (N, 2) of the false objects of a step, of a detector or a screen of so many columns and rows."""
    random = np.random.default_rng((scene.seed, step))
    return np.asarray(random.random((scene.false_objects, 2)) * (columns - 1, rows - 1))


FALSE_MAGNITUDES = 2.0, 5.0
"""False objects are as bright as the stars of a field, evenly spread between these."""


def false_magnitudes(scene: SceneSection) -> NDArray[np.float64]:
    """Magnitudes (N,) of the false objects."""
    return np.linspace(*FALSE_MAGNITUDES, scene.false_objects)
