"""Figures on sky and detector: the track of the boresight, and the residuals of the stars."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from gse.report.plot_data import PlotData, sample
from gse.report.svg import set_margins
from gse.values.attitude import Attitude
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD
from gse.view.drawing import BLUE, GREEN, VERMILLION, field_outline_icrs, hex_of

_MAX_POINTS = 1500
_CELLS = 12
_FEWEST = 3
_MATCHES_AT_ONCE = 1 << 16
_NEAR_POLE_DEG = 75.0
_ANGLES = ("ra_deg", "de_deg", "roll_deg", "ra_true_deg", "de_true_deg")


def draw_sky(figure: Figure, data: PlotData) -> None:
    """Measured and true boresight on the sky, and the field of view at the beginning and the end."""
    answered = np.flatnonzero(~data.unidentified)
    rows = answered[sample(len(answered), _MAX_POINTS)]
    measured = {name: data.frames[name][rows] for name in _ANGLES}
    set_margins(figure, right_in=1.4)
    near_pole = len(rows) > 0 and bool(np.abs(measured["de_deg"]).max() > _NEAR_POLE_DEG)
    axes = figure.subplots(subplot_kw={"projection": "polar"} if near_pole else {})
    place = _Places(axes, measured["ra_deg"], measured["de_deg"], polar=near_pole)
    place.draw(measured["ra_true_deg"], measured["de_true_deg"], color=hex_of(VERMILLION), linewidth=4, label="true")
    place.draw(measured["ra_deg"], measured["de_deg"], color=hex_of(BLUE), linewidth=1, label="measured")
    camera = data.session.station.sensor.camera()
    for row, style in ((0, ":"), (-1, "-")) if len(rows) else ():
        ra_deg, de_deg, roll_deg = (float(measured[name][row]) for name in ("ra_deg", "de_deg", "roll_deg"))
        place.draw(*_outline(ra_deg, de_deg, roll_deg, camera), color=hex_of(GREEN), linestyle=style)
    axes.plot([], [], color=hex_of(GREEN), linestyle=":", label="field, first frame")
    axes.plot([], [], color=hex_of(GREEN), label="field, last frame")
    axes.set_title("Boresight on the sky (ICRS)")
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0))


class _Places:
    """Right ascension to the left and declination up; about the pole, right ascension around and its distance out."""

    def __init__(self, axes: Axes, ra_deg: NDArray[np.float64], de_deg: NDArray[np.float64], *, polar: bool) -> None:
        self._axes, self._polar = axes, polar
        self._sign = 1.0 if not len(de_deg) or de_deg.mean() >= 0 else -1.0
        self._zero_deg = float(ra_deg[0]) if len(ra_deg) else 0.0
        if polar:
            return
        middle_deg = float(np.median(de_deg)) if len(de_deg) else 0.0
        axes.set_aspect(1 / max(np.cos(np.radians(middle_deg)), 0.1), adjustable="datalim")
        axes.xaxis.set_inverted(True)
        axes.set_xlabel("RA (deg)")
        axes.set_ylabel("DE (deg)")
        axes.xaxis.set_major_formatter(lambda value, _: f"{value % 360:g}")

    def draw(self, ra_deg: NDArray[np.float64], de_deg: NDArray[np.float64], **style: Any) -> None:
        if self._polar:
            self._axes.plot(np.radians(ra_deg), 90 - self._sign * de_deg, **style)
            return
        turned = self._zero_deg + np.unwrap(ra_deg - self._zero_deg, period=360) if len(ra_deg) else ra_deg
        self._axes.plot(turned, de_deg, **style)


def _outline(
    ra_deg: float, de_deg: float, roll_deg: float, camera: Camera
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """RA and DE (M,) of the edge of the field; an answer of RA and DE alone has no roll."""
    attitude = Attitude.from_angles(ra_deg, de_deg, np.nan_to_num(roll_deg))
    x, y, z = field_outline_icrs(attitude, camera).T
    edge_ra_deg = np.degrees(np.arctan2(y, x))
    # The outline begins near the boresight's own right ascension, not a turn away.
    edge_ra_deg += 360 * np.round((ra_deg - edge_ra_deg[0]) / 360)
    return edge_ra_deg, np.degrees(np.arctan2(z, np.hypot(x, y)))


def draw_residual_map(figure: Figure, data: PlotData) -> None:
    """Mean residual of the stars in each cell of the detector, as an arrow, and its rms as a colour."""
    set_margins(figure, top_in=0.45)
    axes = figure.subplots()
    camera, matches = data.session.station.sensor.camera(), data.session.frames.matches
    pixel_arcsec = camera.pixel_rad * ARCSEC_PER_RAD
    axes.set_title("Residuals of the stars over the detector")
    axes.set_xlabel("column (px)")
    axes.set_ylabel("row (px)")
    axes.set_xlim(-0.5, camera.columns - 0.5)
    axes.set_ylim(camera.rows - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.grid(visible=False)
    if not len(matches):
        return
    size = max(camera.columns, camera.rows) / _CELLS
    across, down = int(np.ceil(camera.columns / size)), int(np.ceil(camera.rows / size))
    count, (mean_x, mean_y, mean_square) = _means(matches, size, across, across * down)
    mean_x = -mean_x if camera.mirrored else mean_x
    rms = np.sqrt(mean_square)
    image = axes.pcolormesh(
        np.arange(across + 1) * size - 0.5,
        np.arange(down + 1) * size - 0.5,
        np.where(count >= _FEWEST, rms, np.nan).reshape(down, across),
        cmap="cividis",
        vmin=0,
    )
    figure.colorbar(image, ax=axes, label="rms of the residual (arcsec)", shrink=0.9)
    full = np.flatnonzero(count >= _FEWEST)
    if len(full):
        centre_x, centre_y = (np.asarray((place + 0.5) * size) for place in (full % across, full // across))
        _arrows(axes, (centre_x, centre_y), (mean_x[full], mean_y[full]), size, pixel_arcsec)


def _means(
    matches: NDArray[np.void], size_px: float, across: int, cells: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Matches in each cell of the detector, and the means (3, cells) of their residuals in x, in y, and squared."""
    count, sums = np.zeros(cells, dtype=np.int64), np.zeros((3, cells))
    for first in range(0, len(matches), _MATCHES_AT_ONCE):
        part = matches[first : first + _MATCHES_AT_ONCE]
        column = np.clip((part["x_px"] + 0.5) / size_px, 0, across - 1).astype(np.int64)
        cell = np.clip((part["y_px"] + 0.5) / size_px, 0, cells // across - 1).astype(np.int64) * across + column
        x, y = (np.asarray(part[f"residual_{axis}_arcsec"], dtype=np.float64) for axis in "xy")
        count += np.bincount(cell, minlength=cells)
        sums += [np.bincount(cell, values, cells) for values in (x, y, x**2 + y**2)]
    return count, sums / np.maximum(count, 1)


def _arrows(
    axes: Axes,
    places: tuple[NDArray[np.float64], NDArray[np.float64]],
    means: tuple[NDArray[np.float64], NDArray[np.float64]],
    size_px: float,
    pixel_arcsec: float,
) -> None:
    """The longest arrow is as long as a cell; the title tells its scale."""
    longest = max(float(np.hypot(*means).max()), 1e-9)
    style: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": longest / size_px, "width": 0.004}
    axes.quiver(*places, *means, color=hex_of(VERMILLION), **style)
    scale = f"the longest {longest:.2f} arcsec = {longest / pixel_arcsec:.3f} px"
    axes.set_title(f"Residuals of the stars over the detector\narrows: mean in a cell, {scale}")
