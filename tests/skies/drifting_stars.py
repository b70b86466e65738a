"""Residuals of stars that drift over a resting detector, with known errors: pixel phase, blends, scale, rounding.

No identifier and no station: places of the catalogue, a camera, and a small-angle fit of each frame's attitude.
"""

import math
from dataclasses import dataclass

import numpy as np

from gse.catalog import load_catalog
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.values.attitude import Attitude

ARCSEC = math.pi / (180 * 3600)
DE_DEG, ROLL_DEG = -6.5, 0.0
EARTH_RATE_DEG_S = 15.041 / 3600


@dataclass(frozen=True)
class Drifted:
    """Columns (N,) of the matched stars of all frames."""

    residual: np.ndarray
    xy_px: np.ndarray
    phase_px: np.ndarray
    field_deg: np.ndarray
    star: np.ndarray
    frame: np.ndarray
    utc_ns: np.ndarray
    boresight_deg: np.ndarray
    size_px: tuple[int, int]
    pixel_arcsec: float


def drifting_stars(
    hours=8.0,
    *,
    step_s=2.0,
    noise_px=0.2,
    phase_px=(0.0, 0.0),
    blend=None,
    focal_length_error=0.0,
    whole_pixels=False,
    most=14,
    seed=1,
    start_deg=120.0,
):
    """``phase_px`` are amplitudes of sin(2 pi phase) along columns and rows; ``blend`` is (row of a star, east, north)
    in arcsec. Frames have the ``most`` brightest stars to magnitude 6."""
    rng = np.random.default_rng(seed)
    camera = parse_station(BUILT_IN_TEXT).sensor.camera()
    catalog = load_catalog(stars=6000)
    catalog = catalog.rows(np.flatnonzero(catalog.magnitude < 6.0))
    parts = []
    for number in range(round(hours * 3600 / step_s)):
        ra_deg = (start_deg + number * step_s * EARTH_RATE_DEG_S) % 360
        attitude = Attitude.from_angles(ra_deg, DE_DEG, ROLL_DEG)
        near = np.flatnonzero(catalog.icrs @ attitude.boresight_icrs > math.cos(camera.diagonal_rad / 2))
        true = catalog.icrs[near] @ attitude.icrs_to_sensor.T
        shifted = true.copy()
        if blend is not None and blend[0] in near:
            star = int(np.flatnonzero(near == blend[0])[0])
            icrs = catalog.icrs[blend[0]]
            east = np.cross([0.0, 0.0, 1.0], icrs)
            east /= np.linalg.norm(east)
            moved = icrs + (blend[1] * east + blend[2] * np.cross(icrs, east)) * ARCSEC
            shifted[star] = attitude.icrs_to_sensor @ (moved / np.linalg.norm(moved))
        xy = camera.pixels(shifted)
        inside = np.flatnonzero(camera.contains(xy))[:most]
        xy, true = xy[inside], true[inside]
        middle = np.array(camera.principal_point_px)
        xy = middle + (xy - middle) * (1 + focal_length_error)
        xy = xy + np.array(phase_px) * np.sin(2 * math.pi * (xy - np.round(xy)))
        xy = xy + rng.normal(0, noise_px, xy.shape)
        if whole_pixels:
            xy = np.round(xy)
        measured = camera.directions(xy)
        residual = _fitted(measured, true) / ARCSEC
        expected = measured.copy()
        expected[:, :2] -= residual * ARCSEC
        expected_px = camera.pixels(expected)
        ones = np.ones(len(inside))
        parts.append(
            (
                residual,
                xy,
                expected_px - np.floor(expected_px + 0.5),
                np.degrees(np.arctan2(measured[:, :2], measured[:, 2:])),
                near[inside],
                number * ones.astype(np.int64),
                (round(number * step_s * 1e9) * ones).astype(np.int64),
                np.outer(ones, [ra_deg, DE_DEG, ROLL_DEG]),
            )
        )
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    return Drifted(*columns, (camera.columns, camera.rows), camera.pixel_rad / ARCSEC)


def _fitted(measured, true):
    """Residuals along columns and rows after the rotation that fits best."""
    x, y, z = true.T
    rows = np.concatenate([np.column_stack([np.zeros_like(x), z, -y]), np.column_stack([-z, np.zeros_like(x), x])])
    apart = (measured - true)[:, :2].T.ravel()
    turn, *_ = np.linalg.lstsq(rows, apart, rcond=None)
    return (apart - rows @ turn).reshape(2, -1).T
