"""Figures of the distribution of the errors: scatter, histogram, spectrum."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle
from matplotlib.ticker import LogLocator
from numpy.typing import NDArray

from gse.report.plot_data import PlotData, angle_unit, edge_of, sample
from gse.values.axis import D_DE, D_RA_COSDE, ON_SKY
from gse.values.limits import Limits
from gse.verdict.requirements import SlewStep
from gse.view.drawing import BLUE, GREEN, GREY, ORANGE, SKY_BLUE, VERMILLION, hex_of

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
