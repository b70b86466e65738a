"""What a wrong camera or wrong air does to the stars over the field, and to the attitude that follows from them.

A displacement of the stars is partly taken up by the attitude of the frame; the rest stays in the residuals. A wrong
focal length that turned the attitude by an arcsecond because the stars stood on one side is told from a moving mount by
this: both parts are predicted from the places of the very stars that were there.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.station.session_tables import residuals_of, thinned, xy_px_of
from gse.truth import Refraction, time_blocks
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.matrices import lstsq, pinv, product
from gse.values.site import Site
from gse.values.star_influence import FrameFits, boresight_shifts, star_covariance, unfitted

PARAMETERS = (
    *("focal length", "k1", "k2", "p1", "p2", "principal point x", "principal point y"),
    *("pixel pitch", "pressure"),
)
"""Each is the truth less what is stated: the focal length as a share, the points in px, the pressure in hPa.

The pixel pitch is by how much a column is wider than a row, as a share: half of it each way.
"""

_STEPS = (1e-5, 1e-4, 1e-4, 1e-4, 1e-4, 0.1, 0.1, 1e-5, 300.0)
_MOST_ROWS = 40_000
_FEWEST_ROWS = 100
_SHOWN_ROWS = 1000
_FEWEST_STARS = 4
_OUTLIER = 5.0
_WHOLE_PIXELS_HIDE_PX, _CENTROIDS_HIDE_PX = 0.02, 0.01
"""Root mean square by which stars that keep their place on the pixels lie off for a whole session."""


@dataclass(frozen=True, slots=True, eq=False)
class FieldOfErrors:
    """Residuals of stars against the patterns of PARAMETERS.

    ``normal`` (F, F) and ``right`` (F,) are the normal equations in units of the residuals' variance, for which
    sums over one star count as one (as its errors depend on each other), with ``freedom``; ``by_star`` (S, F, F) and
    ``right_by_star`` (S, F) are the parts of these that single stars give. ``shifts`` (L, 3, F) are
    what each pattern does to the attitude of the frames ``rows`` (L,), in arcsec per unit. ``moved_px`` (Q, 2, F)
    are displacements of some of the stars per unit; root mean squares below ``least_px`` may be the pixels'.
    """

    normal: NDArray[np.float64]
    right: NDArray[np.float64]
    freedom: float
    by_star: NDArray[np.float64]
    right_by_star: NDArray[np.float64]
    rows: NDArray[np.int64]
    shifts: NDArray[np.float64]
    stars: "StarErrors"
    moved_px: NDArray[np.float64]
    least_px: float

    def most_told_by(self, parts: NDArray[np.int64]) -> int:
        """The star that tells most of some parameters together."""
        inverse = pinv(self.normal[np.ix_(parts, parts)], rcond=1e-12)
        return int(np.einsum("spq,qp->s", self.by_star[:, parts[:, None], parts], inverse).argmax())


@dataclass(frozen=True, slots=True, eq=False)
class StarErrors:
    """Errors (N, 2) of single stars, and the operators (N, 3, 2) that make attitude errors of them.

    ``phases`` (N, 2), complex, of modulus 1, turn once while a star crosses a pixel; ``phase_arcsec`` is the root mean
    square of the part of the errors that goes with them.
    """

    frames: NDArray[np.int64]
    utc_ns: NDArray[np.int64]
    stars: NDArray[np.int64]
    operators: NDArray[np.float64]
    errors: NDArray[np.float64]
    phases: NDArray[np.complex128]
    phase_arcsec: float

    @property
    def freedom(self) -> float:
        """Degrees of freedom of what single stars keep: two axes of each, less the attitude."""
        return float(max(2 * len(np.unique(self.stars)) - 3, 1))

    def covariance_arcsec2(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Covariance (P, P) of sums of the boresight's errors with weights (N, P, 3), by what single stars keep."""
        operators = product(weights, boresight_shifts(np.eye(3)).T, self.operators)
        lasting = star_covariance(operators, self.errors, self.stars, time_blocks(self.utc_ns), within_blocks=False)
        return lasting + self._of_phases(operators)

    def _of_phases(self, operators: NDArray[np.float64]) -> NDArray[np.float64]:
        """The part of stars that err with their place on a pixel.

        What a star leaves that crosses many pixels is next to nothing; one that stays keeps its error.
        """
        _, star = np.unique(self.stars, return_inverse=True)
        sums = np.zeros((int(star.max()) + 1, *operators.shape[1:]), dtype=np.complex128)
        np.add.at(sums, star, operators * self.phases[:, None, :])
        return np.asarray(np.einsum("sia,sja->ij", sums, sums.conj()).real * self.phase_arcsec**2)


def field_of_errors(
    matches: NDArray[np.void],
    utc_ns: NDArray[np.int64],
    used: NDArray[np.bool_],
    camera: Camera,
    site: Site,
    zenith_sensor: NDArray[np.float64],
) -> FieldOfErrors | None:
    """Of matches (rows of MATCH) in used (M,) frames at instants (M,); None where they are too few to tell."""
    matches = matches.compress(used[matches["frame"]])
    if len(matches) < _FEWEST_ROWS:
        return None
    matches = thinned(matches, _MOST_ROWS)
    residuals = residuals_of(matches)
    length = np.hypot(residuals[:, 0], residuals[:, 1])
    good = length <= _OUTLIER * max(float(np.median(length)), 1e-6)
    matches, residuals = matches.compress(good), residuals[good]
    _, place, count = np.unique(matches["frame"], return_inverse=True, return_counts=True)
    full = count[place] >= _FEWEST_STARS
    matches, residuals = matches.compress(full), residuals[full]
    if len(matches) < _FEWEST_ROWS:
        return None
    return _fitted(matches, residuals, utc_ns, camera, site, zenith_sensor)


def _fitted(
    matches: NDArray[np.void],
    residuals: NDArray[np.float64],
    utc_ns: NDArray[np.int64],
    camera: Camera,
    site: Site,
    zenith_sensor: NDArray[np.float64],
) -> FieldOfErrors:
    xy_px = xy_px_of(matches)
    fits = FrameFits.from_directions(camera.directions(xy_px), matches["frame"])
    patterns = np.stack(list(_patterns(camera, site, zenith_sensor, xy_px)), axis=2)
    left, turns = _unabsorbed(patterns, fits)
    design = left.reshape(-1, len(PARAMETERS))
    normal, right = product(design.T, design), product(design.T, residuals.ravel())
    fit = _solved(normal, right)
    rest = residuals - product(left, fit)
    _, star, sightings = np.unique(matches["star"], return_inverse=True, return_counts=True)
    variance, freedom = _variance_of_sums(rest, star, sightings, len(PARAMETERS))
    variance = max(variance, _variance_of_pulls(left, rest, star, normal))
    of_each_star = np.split(left.take(np.argsort(star, kind="stable"), axis=0), np.cumsum(sightings)[:-1])
    frames = matches["frame"].astype(np.int64)
    pixel_arcsec = camera.pixel_rad * ARCSEC_PER_RAD
    of_stars = unfitted(rest, frames)
    phases = np.exp(2j * math.pi * (xy_px - residuals / pixel_arcsec))
    errors = StarErrors(
        frames,
        utc_ns[frames],
        matches["star"].astype(np.int64),
        fits.operators(),
        of_stars,
        phases,
        math.sqrt(2) * abs(complex((of_stars * phases).mean())),
    )
    shifts = np.stack([boresight_shifts(turns[:, :, part]) for part in range(len(PARAMETERS))], axis=2)
    moved_px = patterns[:: -(-len(patterns) // _SHOWN_ROWS)] / pixel_arcsec
    return FieldOfErrors(
        normal / variance,
        right / variance,
        freedom,
        np.array([np.einsum("nip,niq->pq", rows, rows) for rows in of_each_star]) / variance,
        _of_each(np.einsum("nip,ni->np", left, residuals), star) / variance,
        fits.numbers.astype(np.int64),
        shifts,
        errors,
        moved_px,
        _WHOLE_PIXELS_HIDE_PX if (xy_px == np.rint(xy_px)).all() else _CENTROIDS_HIDE_PX,
    )


def _unabsorbed(patterns: NDArray[np.float64], fits: FrameFits) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Patterns (N, 2, F) without the turns (L, 3, F) of each frame that an attitude makes of them, and these."""
    turns = fits.turns(patterns)
    x, y, z = fits.directions_sensor.T[:, :, None]
    turn_x, turn_y, turn_z = np.moveaxis(turns.take(fits.place, axis=0), 1, 0)
    left = patterns.copy()
    left[:, 0] -= turn_y * z - turn_z * y
    left[:, 1] -= turn_z * x - turn_x * z
    return left, turns


def unexplained_residuals(
    field: FieldOfErrors,
    matches: NDArray[np.void],
    camera: Camera,
    site: Site,
    zenith_sensor: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Residuals (N, 2) of matches (rows of MATCH) in arcsec, without the patterns as they fit the field."""
    xy_px = xy_px_of(matches)
    patterns = np.stack(list(_patterns(camera, site, zenith_sensor, xy_px)), axis=2)
    left, _ = _unabsorbed(patterns, FrameFits.from_directions(camera.directions(xy_px), matches["frame"]))
    residuals = residuals_of(matches)
    return np.asarray(residuals - product(left, _solved(field.normal, field.right)))


def _solved(normal: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """The parameters (F,) of normal equations, zero along what they do not tell."""
    size = np.sqrt(np.diag(normal))
    return np.asarray(lstsq(_scaled(normal), right / size, rcond=1e-9) / size)


def _scaled(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """With ones on its diagonal, solved for parameters in units of their own patterns."""
    size = np.sqrt(np.diag(normal))
    return np.asarray(normal / size[:, None] / size)


def _variance_of_sums(
    rest: NDArray[np.float64], star: NDArray[np.int64], sightings: NDArray[np.int64], fitted: int
) -> tuple[float, float]:
    """The variance of a residual, times the share by which those of one star add up; with its degrees of freedom."""
    sums = np.column_stack([np.bincount(star, weights=part) for part in rest.T])
    freedom = max(2 * len(sightings) - fitted, 1)
    together = float((sums**2).sum()) / len(rest) / 2
    return max(together * 2 * len(sightings) / freedom, float((rest**2).mean())), float(freedom)


def _variance_of_pulls(
    left: NDArray[np.float64], rest: NDArray[np.float64], star: NDArray[np.int64], normal: NDArray[np.float64]
) -> float:
    """The same from how single stars pull at the parameters (Liang & Zeger 1986): the greatest over the parameters.

    A star at the edge of the field pulls more than its share, and keeps its error for as long as it stays on its pixel.
    """
    pulls = _of_each(np.einsum("nip,ni->np", left, rest), star)
    count = len(pulls)
    return float(((pulls**2).sum(axis=0) / np.diag(normal)).max()) * count / max(count - len(PARAMETERS), 1)


def _of_each(values: NDArray[np.float64], star: NDArray[np.int64]) -> NDArray[np.float64]:
    """Sums (S, P) of values (N, P) over each star."""
    return np.column_stack([np.bincount(star, weights=part) for part in values.T])


def _patterns(
    camera: Camera, site: Site, zenith_sensor: NDArray[np.float64], xy_px: NDArray[np.float64]
) -> Iterator[NDArray[np.float64]]:
    """Measured less true directions (N, 2), in arcsec, per unit of each of PARAMETERS."""
    stated = camera.directions(xy_px)
    for changed, step in zip(_cameras(camera), _STEPS, strict=False):
        yield (stated - changed.directions(xy_px))[:, :2] * (ARCSEC_PER_RAD / step)
    middle, stretch = np.array(camera.principal_point_px), 1 + np.array([0.5, -0.5]) * _STEPS[-2]
    stretched = camera.directions(middle + (xy_px - middle) * stretch)
    yield (stated - stretched)[:, :2] * (ARCSEC_PER_RAD / _STEPS[-2])
    air = replace(site, pressure_hpa=site.air_pressure_hpa, temperature_c=site.air_temperature_c)
    more = replace(air, pressure_hpa=air.air_pressure_hpa + _STEPS[-1])
    straight, straighter = (Refraction.at(one).removed(stated, zenith_sensor) for one in (air, more))
    yield (straight - straighter)[:, :2] * (ARCSEC_PER_RAD / _STEPS[-1])


def _cameras(camera: Camera) -> Iterator[Camera]:
    """Cameras with one parameter greater by its step."""
    (k1, k2), (x, y) = camera.radial_distortion, camera.principal_point_px
    p1, p2 = camera.tangential_distortion
    yield replace(camera, focal_length_px=camera.focal_length_px * (1 + _STEPS[0]))
    yield replace(camera, radial_distortion=(k1 + _STEPS[1], k2))
    yield replace(camera, radial_distortion=(k1, k2 + _STEPS[2]))
    yield replace(camera, tangential_distortion=(p1 + _STEPS[3], p2))
    yield replace(camera, tangential_distortion=(p1, p2 + _STEPS[4]))
    yield replace(camera, principal_point_px=(x + _STEPS[5], y))
    yield replace(camera, principal_point_px=(x, y + _STEPS[6]))
