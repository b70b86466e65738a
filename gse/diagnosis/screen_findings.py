"""What is wrong with a screen before the sensor, by the stars that the sensor saw on it."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from gse.station.events import Finding, StationKind
from gse.station.session_data import SessionData
from gse.station.session_tables import residuals_of, thinned, xy_px_of
from gse.values.constants import ARCSEC_RAD
from gse.values.screen import Screen

_MOST_STARS = 20_000
_FEWEST = 10
"""Stars that tell a scale, or a gamma."""
_SIGMAS = 5.0
_LEAST_SCALE = 5e-4
"""A quarter of a pixel at the edge of 1024."""
_LEAST_GAMMA = 0.15


def screen_findings(session: SessionData) -> Iterator[Finding]:
    """A mirrored monitor, a picture of another size, another gamma; nothing without a screen."""
    screen = session.station.screen
    if screen is None:
        return
    events = {event.kind: event for event in session.events}
    if StationKind.MIRRORED in events:
        equals = ("a mirror in the way", "sensor.mirrored")
        following = "switch the mirroring of the monitor off, or turn sensor.mirrored over"
        yield Finding(
            "mirrored image", f"the monitor is mirrored: {events[StationKind.MIRRORED].text}", equals, following
        )
    elif StationKind.WRONG_CAMERA in events:
        yield _size(events[StationKind.WRONG_CAMERA].text)
    # Those too that the answer left out: of a picture of another size they stand farthest from their places.
    stars = thinned(session.frames.matches, _MOST_STARS)
    excess, sigma = _scale(stars, session)
    if StationKind.WRONG_CAMERA not in events and abs(excess) > max(_SIGMAS * sigma, _LEAST_SCALE):
        yield _size(screen.of_size(1 + excess))
    yield from _gamma(stars, session, screen)


def _size(size: str) -> Finding:
    equals = ("a zoom of the browser or a scale of the display", "sensor.focal_length_px")
    following = "measure the panel and set zoom and scale to 100 %; then fit it: gse run --scene screen-fit, gse align"
    return Finding("focal length", size, equals, following)


def _scale(stars: NDArray[np.void], session: SessionData) -> tuple[float, float]:
    """By how much stars stand farther out than they should, as a share, with its standard error by stars."""
    camera = session.station.sensor.camera()
    if len(np.unique(stars["star"])) < _FEWEST:
        return 0.0, math.inf
    directions = camera.directions(xy_px_of(stars))
    tangents, residuals = directions[:, :2] / directions[:, 2:], residuals_of(stars) * ARCSEC_RAD
    # Of a fitted attitude the mean of each frame is gone, and so it is taken out of the places.
    _, frame = np.unique(stars["frame"], return_inverse=True)
    count = np.bincount(frame)[:, None]
    mean = np.column_stack([np.bincount(frame, tangents[:, k]) for k in range(2)]) / count
    tangents = tangents - mean[frame]
    weight = float((tangents**2).sum())
    slope = float((tangents * residuals).sum()) / weight
    scores = (tangents * (residuals - slope * tangents)).sum(axis=1)
    _, star = np.unique(stars["star"], return_inverse=True)
    by_star = np.bincount(star, scores)
    widening = float(stdtrit(len(by_star) - 1, 0.975)) / 1.96
    return slope, widening * math.sqrt(float((by_star**2).sum())) / weight


def _gamma(stars: NDArray[np.void], session: SessionData, screen: Screen) -> Iterator[Finding]:
    """Another brightness law than stated; the catalogue's magnitudes and the stars at rest tell it."""
    if session.stars is None or not session.shown.shown or not len(stars):
        return
    from gse.imaging.screen_fit import (
        ScreenStars,
        fit_gamma,
    )  # optimisers, which sessions under the sky need not wait for

    star, utc_ns = stars["star"].astype(np.int64), session.frames.columns["utc_ns"][stars["frame"]]
    nowhere = np.zeros((len(star), 3))
    magnitude, index = session.stars.magnitude[star], stars["brightness"].astype(np.float64)
    seen = ScreenStars(nowhere[:, :2], nowhere, magnitude, index, utc_ns, star)
    sky = replace(session.shown, shown=list(session.shown.shown))
    gamma, half_width = fit_gamma(seen, sky, screen, session.station.sensor.index_max)
    if abs(gamma - screen.gamma) > max(_SIGMAS / 2 * half_width, _LEAST_GAMMA):
        yield Finding(
            "gamma of the screen",
            f"bright and faint stars differ as on a panel of gamma {gamma:.2f} +- {half_width:.2f}, "
            f"screen.gamma is {screen.gamma:g}",
            ("a night light", "a picture mode, dynamic contrast", "a sensor whose index values are not linear"),
            "switch night light and picture modes off; then fit it: gse run --scene screen-fit, gse align",
        )
