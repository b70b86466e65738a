"""The plots of a session's report, by name; whoever imports this waits for matplotlib.

Here are those of the sky, of the detector and of the distribution of errors; gse.report.time_plots has those over time.
"""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle
from matplotlib.ticker import LogLocator
from numpy.typing import NDArray

from gse.report.plot_data import PlotData, angle_unit, edge_of, sample
from gse.report.svg import Draw, set_margins, svgs_of
from gse.report.time_plots import (
    draw_errors,
    draw_housekeeping,
    draw_identification_time,
    draw_paper,
    draw_sky_condition,
    draw_timelines,
    items_to_draw,
)
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.statistics.session_statistics import Statistics
from gse.values.attitude import Attitude
from gse.values.axis import D_DE, D_RA_COSDE, ON_SKY
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.limits import Limits
from gse.verdict.assessment import Assessment
from gse.verdict.requirements import SlewStep
from gse.view.drawing import BLUE, GREEN, GREY, ORANGE, SKY_BLUE, VERMILLION, field_outline_icrs, hex_of

_MAX_ON_SKY = 1500
_CELLS = 12
_FEWEST = 3
_MATCHES_AT_ONCE = 1 << 16
_NEAR_POLE_DEG = 75.0
_ANGLES = ("ra_deg", "de_deg", "roll_deg", "ra_true_deg", "de_true_deg")


def draw_sky(figure: Figure, data: PlotData) -> None:
    """Measured and true boresight on the sky, and the field of view at the beginning and the end."""
    answered = np.flatnonzero(~data.unidentified)
    rows = answered[sample(len(answered), _MAX_ON_SKY)]
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


# The spectrum of an error axis; frames may be missing.

_SPECTRUM_BINS = 150
_MAX_SLOTS = 1 << 22
"""Most slots of a spectrum; of a longer night (five days at 10 Hz) the first ones are drawn."""


def power_density(
    time_s: NDArray[np.float64], error_arcsec: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies in Hz and one-sided power spectral density in arcsec^2/Hz, averaged in logarithmic bins.

    The periodogram of the errors less their mean, with zeros where a frame is missing (Schuster's; a night misses few).
    White noise of standard deviation s at a rate r is flat at 2 s^2/r. Empty for fewer than 16 frames.
    """
    if len(time_s) < 16:
        return np.empty(0), np.empty(0)
    step_s = float(np.median(np.diff(time_s)))
    span_s = float(time_s[-1] - time_s[0])
    if step_s <= 0 or span_s <= 0:
        return np.empty(0), np.empty(0)
    errors, count = _on_slots(time_s, error_arcsec, step_s)
    length = _quick_length(len(errors))
    power = np.abs(np.fft.rfft(errors, length)) ** 2 / count
    frequency = np.fft.rfftfreq(length, step_s)
    return _averaged(frequency[1:].astype(np.float64), 2 * step_s * power[1:])


def _quick_length(length: int) -> int:
    """The next of at most 64 times a power of two: a length with a great prime takes six times the memory and time.

    The zeros that are added, a thirtieth at most, move the frequencies a little.
    """
    step = 1 << max(length.bit_length() - 6, 0)
    return -(-length // step) * step


def _on_slots(
    time_s: NDArray[np.float64], error_arcsec: NDArray[np.float64], step_s: float
) -> tuple[NDArray[np.float64], int]:
    """The errors less their mean, one for each step of time, and how many there are."""
    slot = np.rint((time_s - time_s[0]) / step_s).astype(np.int64)
    drawn = int(np.searchsorted(slot, _MAX_SLOTS))
    errors = np.bincount(slot[:drawn], error_arcsec[:drawn] - error_arcsec[:drawn].mean())
    return np.asarray(errors, dtype=np.float64), drawn


def _averaged(
    frequency: NDArray[np.float64], density: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    edges = np.geomspace(frequency[0], frequency[-1] * (1 + 1e-9), _SPECTRUM_BINS + 1)
    place = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, _SPECTRUM_BINS - 1)
    count = np.bincount(place, minlength=_SPECTRUM_BINS)
    filled = count > 0
    centre = np.bincount(place, frequency, _SPECTRUM_BINS)[filled] / count[filled]
    return centre, np.bincount(place, density, _SPECTRUM_BINS)[filled] / count[filled]


_MAX_POINTS = 3000
_BINS = 60
_POINT = 1.0
"""Diameter of a point, in points."""


def draw_scatter(figure: Figure, data: PlotData) -> None:
    """dRA* and dDE of the frames, as they lie within the limits, and close up with the 1 and 3 sigma rings."""
    wide, close = figure.subplots(1, 2)
    limits = data.session.station.limits
    x, y = (data.used(axis.column) for axis in ON_SKY)
    box = (limits.of(D_RA_COSDE), limits.of(D_DE))
    scale, unit = angle_unit(max(edge_of(x, box[0]), edge_of(y, box[1])))
    x, y, box = x * scale, y * scale, (box[0] * scale, box[1] * scale)
    style: dict[str, Any] = {"fill": False, "edgecolor": hex_of(VERMILLION), "zorder": 3}
    wide.add_patch(Rectangle((-box[0], -box[1]), 2 * box[0], 2 * box[1], **style))
    _points(wide, x, y)
    edge = max(edge_of(x, box[0]), edge_of(y, box[1]))
    wide.set_xlim(-edge, edge)
    wide.set_ylim(-edge, edge)
    wide.set_title(f"{data.subject}: within the limits (box)")
    _points(close, x, y)
    if len(x) > 2:
        _rings(close, x, y)
    close.set_title("Close up: mean, 1 and 3 sigma")
    for axes in (wide, close):
        axes.set_aspect("equal")
        axes.axhline(0, color=hex_of(GREY), linewidth=0.5)
        axes.axvline(0, color=hex_of(GREY), linewidth=0.5)
        axes.set_xlabel(f"{D_RA_COSDE.label} ({unit})")
        axes.set_ylabel(f"{D_DE.label} ({unit})")


def _points(axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
    """Round-ended strokes without length, in one path: as markers each would be an element of its own."""
    rows = sample(len(x), _MAX_POINTS)
    strokes = [np.repeat(values[rows], 3) for values in (x, y)]
    strokes[1][2::3] = np.nan
    axes.plot(*strokes, color=hex_of(SKY_BLUE), linewidth=_POINT, solid_capstyle="round", zorder=1)


def _rings(axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
    mean, std = (float(x.mean()), float(y.mean())), (float(x.std(ddof=1)), float(y.std(ddof=1)))
    for n in (1, 3):
        axes.add_patch(Ellipse(mean, 2 * n * std[0], 2 * n * std[1], fill=False, edgecolor=hex_of(GREEN), zorder=2))
    axes.plot(*mean, marker="+", color=hex_of(GREEN), markersize=8)
    half = 4.5 * max(*std, 1e-6)
    axes.set_xlim(mean[0] - half, mean[0] + half)
    axes.set_ylim(mean[1] - half, mean[1] + half)


def draw_histogram(figure: Figure, data: PlotData) -> None:
    """Histograms of both errors with the normal curve of the same mean and standard deviation."""
    for axes, axis, colour in zip(figure.subplots(1, 2), ON_SKY, (SKY_BLUE, ORANGE), strict=True):
        values = data.used(axis.column)
        scale, unit = angle_unit(abs(float(values.mean())) if len(values) else 0.0)
        values = values * scale
        axes.set_xlabel(f"{axis.label} ({unit})")
        axes.set_ylabel("frames")
        if len(values) < 2:
            continue
        mean, std = float(values.mean()), max(float(values.std(ddof=1)), 1e-6)
        inside = values[np.abs(values - mean) <= 5 * std]
        counts, edges = np.histogram(inside, bins=min(_BINS, max(8, len(inside) // 5)))
        axes.stairs(counts, edges, fill=True, color=hex_of(colour))
        at = np.linspace(edges[0], edges[-1], 200)
        normal = np.exp(-0.5 * ((at - mean) / std) ** 2) / (std * math.sqrt(2 * math.pi))
        axes.plot(at, normal * len(values) * (edges[1] - edges[0]), color=hex_of(GREY))
        digits = 4 if unit == "deg" else 2
        far = len(values) - len(inside)
        axes.set_title(f"{axis.label}: mean {mean:+z.{digits}f}, std {std:.{digits}f} {unit}")
        if far:
            axes.text(0.98, 0.95, f"{far} beyond 5 std", transform=axes.transAxes, ha="right", va="top", fontsize=7)
        axes.set_ylim(0, 1.15 * float(np.max(counts)))


def draw_spectrum(figure: Figure, data: PlotData) -> None:
    """Power spectral density of both errors."""
    axes = figure.subplots()
    time_s, first = _instants(data)
    for axis, colour in zip(ON_SKY, (BLUE, ORANGE), strict=True):
        frequency, density = power_density(time_s, data.used(axis.column)[first])
        if len(frequency):
            axes.loglog(frequency, density, color=hex_of(colour), label=axis.label)
    axes.set_title(f"{data.subject}: spectrum of the errors less their mean")
    axes.set_xlabel("frequency (Hz)")
    axes.set_ylabel("arcsec² / Hz")
    if axes.lines:
        axes.legend()
        for side in (axes.xaxis, axes.yaxis):
            side.set_major_formatter("{x:g}")
            side.set_minor_locator(LogLocator(subs=(2, 5)))


def _instants(data: PlotData) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Times of the good frames since the first, each once, and which of the frames (M,) are the first of their time."""
    utc_ns = data.used("utc_ns")
    time_s = (utc_ns - utc_ns[0]) / 1e9 if len(utc_ns) else np.empty(0)
    first = np.diff(time_s, prepend=-1.0) > 0
    return time_s[first], first


def draw_slew(figure: Figure, steps: Sequence[SlewStep], limits: Limits) -> None:
    """Availability and false answers against the slew rate; beside it the errors, and the limit of the rate."""
    rates = [step.rate_deg_per_s for step in steps]
    shares, errors = figure.subplots(1, 2)
    for name, values in (
        ("available", [step.subject.available.value for step in steps]),
        ("false answers", [step.subject.false_answers.value for step in steps]),
    ):
        colour = BLUE if name == "available" else VERMILLION
        shares.plot(rates, [100 * value for value in values], marker="o", color=hex_of(colour), label=name)
    for axis, colour in zip(ON_SKY, (BLUE, ORANGE), strict=True):
        of_axis = [step.subject.axes[axis.key] for step in steps]
        errors.plot(rates, [one.p95_abs_arcsec for one in of_axis], marker="o", color=hex_of(colour),
                    label=f"95 % of |{axis.label}|")  # fmt: skip
        errors.plot(rates, [one.std_arcsec for one in of_axis], marker=".", linestyle="--", color=hex_of(colour),
                    label=f"noise of {axis.label}")  # fmt: skip
    shares.set_ylabel("% of the frames")
    errors.set_ylabel("arcsec")
    for axes in (shares, errors):
        axes.set_xlabel("slew rate (deg/s)")
        if limits.slew_deg_per_s is not None:
            axes.axvline(limits.slew_deg_per_s, color=hex_of(GREY), linestyle=":", label="limits.slew_deg_per_s")
        axes.set_ylim(bottom=0)
        axes.legend()


_PLOTS_OF_SUBJECT = (
    ("errors", 3.0, draw_errors),
    ("paper", 3.6, draw_paper),
    ("scatter", 3.6, draw_scatter),
    ("histogram", 2.4, draw_histogram),
    ("spectrum", 2.6, draw_spectrum),
)
_PLOTS = (
    ("sky", 3.2, draw_sky),
    ("sky_condition", 3.2, draw_sky_condition),
    ("residuals", 4.6, draw_residual_map),
    ("identification", 2.4, draw_identification_time),
    ("timelines", 4.4, draw_timelines),
)
"""Name, height in inches, and what draws it."""
_OF_STARS = ("sky_condition", "residuals")
"""A sensor that sends its own answers alone shows no stars."""


def session_plots(session: SessionData, assessment: Assessment, *, times_recorded: bool) -> dict[str, str]:
    """SVG elements by name; those of a subject have its name before theirs."""
    plotted = _plot_data(session, assessment.statistics)
    items = items_to_draw(session)
    of_stars = _OF_STARS if session.subject is Subject.SENSOR else ()
    without = {*(() if times_recorded else ("identification",)), *of_stars}
    wanted: list[tuple[str, float, Draw]] = [
        (name, height_in, partial(draw, data=plotted[0])) for name, height_in, draw in _PLOTS if name not in without
    ]
    if items:
        height_in = min(0.5 + 0.8 * len(items), 9.0)
        wanted.append(("housekeeping", height_in, partial(draw_housekeeping, data=plotted[0], items=items)))
    for of_subject in plotted:
        wanted += [
            (f"{of_subject.subject}-{name}", height_in, partial(draw, data=of_subject))
            for name, height_in, draw in _PLOTS_OF_SUBJECT
        ]
    for subject, steps in assessment.slew.items():
        wanted.append((f"{subject}-slew", 2.8, partial(draw_slew, steps=steps, limits=session.station.limits)))
    return svgs_of(wanted)


def _plot_data(session: SessionData, stats: Statistics) -> list[PlotData]:
    """What each subject's plots are drawn from, that of the frame table first."""
    found = [PlotData.from_session(session, stats.counted)]
    if stats.own is not None and stats.own_counted is not None:
        found.append(PlotData.of_sensor(session, stats.own, stats.own_counted.used, stats.counted))
    return found
