"""How a screen stands before a sensor, and what light it gives, from the stars that the sensor saw on it.

The page draws each star at a pixel that follows from the stated screen. Where the sensor sees it follows from the real
one: rotation, focal length, radial distortion, and how much later the light comes than was stated, which moves the
stars of a scene that turns. The camera of the sensor is taken as it is stated: a screen cannot tell a longer lens of
its own from a shorter one of the sensor.

Brightness is fitted apart: a panel of another gamma makes a star of light L one of L^(gamma / stated gamma).

A star of a scene at rest stands on the same pixels in each frame, with the same error, and a double star is off
wherever it stands. So the uncertainty is that of a fit to clusters, each a star (Arellano 1987), with Student's t for
their number.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import erfa
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import stdtrit

from gse.errors import UsageError
from gse.identifier import Identification
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD, MAD_TO_SIGMA
from gse.values.instant import NS_PER_S
from gse.values.matrices import pinv, product
from gse.values.mount import InertialUncertainty
from gse.values.panorama import Panorama
from gse.values.screen import Screen, ScreenToSensor, ScreenUncertainty, ShownSky

_FEWEST_STARS = 30
"""Rows of fewer stars than this tell no distortion from a tilt."""
_REACH = 0.5
"""Of half of the screen's width: stars that all stand nearer to its middle do not show its distortion."""
_LEAST_TURN_DEG_PER_S = 0.02
"""A scene that turns more slowly does not show the latency: 10 ms of it are a pixel's hundredth."""
_ROUNDS, _CLIP_SIGMA, _LEAST_CLIP_RAD = 8, 5.0, 1e-7
_HALF_S = 0.005
_OFTEN, _LIGHT_NOISE = 0.8, 0.2
_LEAST_RANGE_MAG = 1.0
_FEWEST_BRIGHT = 10
_SATURATED = 0.95
"""Of the highest index value: a brighter star may be cut."""


@dataclass(frozen=True, slots=True, eq=False)
class ScreenStars:
    """Stars (N,) as the sensor saw them: pixels (N, 2), directions in ICRS (N, 3), magnitudes, index values, UTC.

    ``star`` (N,) is its row in the catalogue.
    """

    xy_px: NDArray[np.float64]
    icrs: NDArray[np.float64]
    magnitude: NDArray[np.float64]
    index: NDArray[np.float64]
    utc_ns: NDArray[np.int64]
    star: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class ScreenFit:
    """The screen as it was fitted, with its uncertainty, and the names of what the stars did not show.

    ``rms_px`` is what the fit leaves, in pixels of the sensor.
    """

    screen: Screen
    stars: int
    rms_px: float
    held: tuple[str, ...]


def seen_stars(
    named: Sequence[tuple[Panorama, Identification]],
    icrs: NDArray[np.float64],
    magnitude: NDArray[np.float64],
    sky: ShownSky,
) -> ScreenStars:
    """The stars of panoramas whose answers name rows of a catalogue, without those over a change of the scene."""
    kept = [(panorama, answer) for panorama, answer in named if sky.is_settled(panorama.utc_ns, panorama.exposure_s)]
    if not kept:
        raise UsageError("no star of the screen was identified; expected a session of 'gse run --scene screen'")
    stars = np.concatenate([answer.stars for _, answer in kept])
    counts = [len(answer.stars) for _, answer in kept]
    utc_ns = np.repeat(np.array([panorama.utc_ns for panorama, _ in kept], dtype=np.int64), counts)
    return ScreenStars(
        np.concatenate([panorama.xy_px[answer.objects] for panorama, answer in kept]),
        icrs[stars],
        magnitude[stars],
        np.concatenate([panorama.brightness[answer.objects] for panorama, answer in kept]),
        utc_ns,
        stars,
    )


def fit_screen(seen: ScreenStars, sky: ShownSky, stated: Screen, sensor: Camera, index_max: int) -> ScreenFit:
    """The screen that explains what was seen; UsageError of too few stars.

    ``sky`` is what was shown, by a page that drew it for the ``stated`` screen.
    """
    on_screen = stated.camera().contains(stated.camera().pixels(_turned(sky, seen, 0)))  # others are misnamed
    seen = ScreenStars(*(getattr(seen, item.name)[on_screen] for item in fields(seen)))
    stars = len(np.unique(seen.star))
    if stars < _FEWEST_STARS:
        raise UsageError(f"{stars} stars of the screen were seen; the fit of a screen needs {_FEWEST_STARS}")
    geometry = _Geometry.from_stars(seen, sky, stated, sensor)
    kept, values = np.ones(len(seen.star), dtype=bool), geometry.start()
    for _ in range(_ROUNDS):
        part = geometry.rows(kept)
        fit = least_squares(part.residuals, values, x_scale="jac")
        values, off = fit.x, np.hypot(*geometry.residuals(fit.x).reshape(-1, 2).T)
        before, kept = kept, off <= max(_CLIP_SIGMA * MAD_TO_SIGMA * float(np.median(off[kept])), _LEAST_CLIP_RAD)
        if (kept == before).all():
            break
    half_widths = _clustered_half_widths(np.asarray(fit.jac), fit.fun, np.repeat(seen.star[before], 2))
    rms_px = float(np.sqrt(np.mean(fit.fun**2))) * sensor.focal_length_px
    screen, held = geometry.screen(values, half_widths)
    gamma, gamma_half_width = fit_gamma(seen, sky, stated, index_max)
    if math.isnan(gamma):
        return ScreenFit(screen, stars, rms_px, (*held, "gamma"))
    uncertainty = replace(screen.uncertainty, gamma=round(gamma_half_width, 4))
    return ScreenFit(replace(screen, gamma=round(gamma, 4), uncertainty=uncertainty), stars, rms_px, held)


_TURN, _SCALE, _DISTORTION, _LATENCY = slice(0, 3), 3, slice(4, 6), 6
"""Places of the parameters: small turn in rad, logarithm of the focal length's factor, k1 and k2, and s."""
_PARAMETERS = 7


@dataclass(frozen=True, slots=True, eq=False)
class _Geometry:
    """Where the page drew stars and how fast they went there, (N, 2) each, and where the sensor saw them, as tangents.

    ``free`` are the places of the parameters that the stars show.
    """

    stated: Screen
    rotation: NDArray[np.float64]
    page_px: NDArray[np.float64]
    page_px_per_s: NDArray[np.float64]
    tangents: NDArray[np.float64]
    free: tuple[int, ...]

    @classmethod
    def from_stars(cls, seen: ScreenStars, sky: ShownSky, stated: Screen, sensor: Camera) -> "_Geometry":
        from scipy.spatial.transform import Rotation

        camera, half_ns = stated.camera(), round(_HALF_S * NS_PER_S)
        page_px, before_px, after_px = (camera.pixels(_turned(sky, seen, utc_ns)) for utc_ns in (0, -half_ns, half_ns))
        directions = sensor.directions(seen.xy_px)
        rotation = Rotation.align_vectors(directions, camera.directions(page_px))[0].as_matrix()
        reach = np.hypot(*(page_px - camera.principal_point_px).T).max() / (stated.columns / 2)
        turns = any(item.rate_deg_per_s > _LEAST_TURN_DEG_PER_S for item in sky.shown)
        free = [0, 1, 2, _SCALE, *((4, 5) if reach > _REACH else ()), *((_LATENCY,) if turns else ())]
        px_per_s = (after_px - before_px) / (2 * _HALF_S)
        return cls(stated, rotation, page_px, px_per_s, directions[:, :2] / directions[:, 2:], tuple(free))

    def rows(self, kept: NDArray[np.bool_]) -> "_Geometry":
        """Of some of the stars."""
        return replace(
            self,
            page_px=self.page_px[kept],
            page_px_per_s=self.page_px_per_s[kept],
            tangents=self.tangents[kept],
        )

    def start(self) -> NDArray[np.float64]:
        """The stated screen, at the rotation that the stars show."""
        return self._free(np.array([0.0, 0.0, 0.0, 0.0, *self.stated.radial_distortion, 0.0]))

    def residuals(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """By how much (2 N,) the stars stand elsewhere than they were seen, in tangents."""
        everything = self._all(values)
        directions = self._camera(everything).directions(self.page_px - self.page_px_per_s * everything[_LATENCY])
        directions = product(directions, self._rotation(everything).T)
        return np.asarray((directions[:, :2] / directions[:, 2:] - self.tangents).ravel())

    def screen(self, values: NDArray[np.float64], half_widths: NDArray[np.float64]) -> tuple[Screen, tuple[str, ...]]:
        """The screen of these parameters with their half-widths of 95 %, and the names of what is held."""
        found, stated = self._all(values), self.stated
        widths = np.zeros(_PARAMETERS)
        widths[list(self.free)] = half_widths
        away = "focal_length_mm" if stated.focal_length_mm is not None else "distance_mm"
        away_mm = (stated.focal_length_mm or stated.distance_mm or math.nan) * math.exp(found[_SCALE])
        across, roll = float(widths[:2].max()) * ARCSEC_PER_RAD, float(widths[2]) * ARCSEC_PER_RAD
        known = InertialUncertainty(across_arcsec=round(across, 3), roll_arcsec=round(roll, 3))
        looks = ScreenToSensor.from_rotation(self._rotation(found), uncertainty=known)
        k1, k2 = (round(float(one), 6) for one in found[_DISTORTION])
        uncertainty = ScreenUncertainty(
            away_mm=round(away_mm * float(widths[_SCALE]), 5),
            radial_distortion=(round(float(widths[4]), 6), round(float(widths[5]), 6)),
        )
        changes: dict[str, object] = {away: round(away_mm, 4), "to_sensor": looks, "uncertainty": uncertainty}
        held = []
        if 4 in self.free:
            changes["radial_distortion"] = (k1, k2)
        else:
            held.append("radial_distortion")
        if _LATENCY in self.free:
            changes["latency_ms"] = round(max(stated.latency_ms + 1000 * float(found[_LATENCY]), 0.0), 3)
            changes["latency_uncertainty_ms"] = round(1000 * float(widths[_LATENCY]), 3)
        else:
            held.append("latency_ms")
        return replace(stated, **changes), tuple(held)  # type: ignore[arg-type]

    def _all(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        everything = np.array([0.0, 0.0, 0.0, 0.0, *self.stated.radial_distortion, 0.0])
        everything[list(self.free)] = values
        return everything

    def _free(self, everything: NDArray[np.float64]) -> NDArray[np.float64]:
        return everything[list(self.free)]

    def _camera(self, everything: NDArray[np.float64]) -> Camera:
        k1, k2 = everything[_DISTORTION].tolist()
        camera = self.stated.camera()
        focal_px = camera.focal_length_px * math.exp(everything[_SCALE])
        return replace(camera, focal_length_px=focal_px, radial_distortion=(k1, k2))

    def _rotation(self, everything: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(product(erfa.rv2m(everything[_TURN]), self.rotation))


def _turned(sky: ShownSky, seen: ScreenStars, later_ns: int) -> NDArray[np.float64]:
    """Directions (N, 3) of stars in the axes of the screen, so much later than they were seen."""
    utc_ns, rows = np.unique(seen.utc_ns, return_inverse=True)
    index = sky.index_at(utc_ns)
    rotations = replace(sky, screen_to_sensor=np.eye(3)).icrs_to_sensor_at(utc_ns + later_ns, index)
    return np.asarray(np.einsum("nij,nj->ni", rotations[rows], seen.icrs))


def _clustered_half_widths(
    jacobian: NDArray[np.float64], residuals: NDArray[np.float64], cluster: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Half-widths of 95 % of the parameters (P,) of a fit whose rows of one cluster are not independent."""
    _, place = np.unique(cluster, return_inverse=True)
    count, parameters = int(place.max()) + 1, jacobian.shape[1]
    scores = np.zeros((count, parameters))
    np.add.at(scores, place, jacobian * residuals[:, None])
    inverse = pinv(product(jacobian.T, jacobian))
    freedom = max(count - parameters, 1)
    covariance = product(inverse, product(scores.T, scores), inverse) * (count / freedom)
    return np.asarray(stdtrit(freedom, 0.975) * np.sqrt(np.diag(covariance)))


def fit_gamma(seen: ScreenStars, sky: ShownSky, stated: Screen, index_max: int) -> tuple[float, float]:
    """The panel's gamma with its half-width of 95 %, by index values of stars at rest; NaN where too few tell it."""
    rates = np.array([item.rate_deg_per_s for item in sky.shown])
    usable = (rates[sky.index_at(seen.utc_ns)] == 0) & (seen.index < _SATURATED * index_max)
    usable &= (seen.magnitude > stated.brightest_magnitude) & (seen.magnitude < stated.magnitude_limit)
    step_of_star = seen.star[usable] * len(rates) + sky.index_at(seen.utc_ns)[usable]
    _, first, place, times = np.unique(step_of_star, return_index=True, return_inverse=True, return_counts=True)
    index = np.bincount(place, seen.index[usable]) / np.maximum(times, 1)
    # Of a star at the limit of detection only the brighter sightings are known.
    often = times > _OFTEN * np.max(times, initial=1)
    magnitude, index = seen.magnitude[usable][first][often], index[often]
    if len(index) < _FEWEST_BRIGHT or np.ptp(magnitude) < _LEAST_RANGE_MAG:
        return math.nan, math.nan
    light = 10 ** (-0.4 * (magnitude - stated.brightest_magnitude))

    def off(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.log(values[0] ** 2 + np.exp(values[1]) * light ** values[2]) - np.log(index))

    fit = least_squares(off, [0.0, float(np.log(index / light).mean()), 1.0], x_scale="jac")
    fit = least_squares(off, [math.sqrt(index.min() / 2), *fit.x[1:]], loss="soft_l1", f_scale=_LIGHT_NOISE)
    jacobian = np.asarray(fit.jac)
    inverse = pinv(product(jacobian.T, jacobian))
    freedom = len(index) - 3
    sigma = math.sqrt(float(inverse[2, 2]) * float((off(fit.x) ** 2).sum()) / freedom)
    return stated.gamma * float(fit.x[2]), stated.gamma * float(stdtrit(freedom, 0.975)) * sigma
