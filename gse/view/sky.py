"""Sky views: the track of the boresight on the celestial sphere, and the scatter of dRA* and dDE."""

import math
from collections.abc import Iterator

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from gse.catalog import StarCatalog
from gse.values.attitude import Attitude
from gse.values.axis import D_DE, D_RA_COSDE, ON_SKY
from gse.values.camera import Camera
from gse.values.instant import NS_PER_S
from gse.values.limits import Limits
from gse.values.matrices import product
from gse.view.drawing import GREEN, GREY, PALE, SKY_BLUE, VERMILLION, YELLOW, field_outline_sensor
from gse.view.live_state import ErrorsSoFar
from gse.view.series import EDGE, times

MAX_CATALOG_STARS = 5000
"""Stars of the sphere: enough for the eye, light enough for a browser."""

TRACK_ROW_NS = 2 * NS_PER_S

_LEGEND = 1.42, 1.72
SCATTER_LEGEND_ENDS = 2.15
"""Places of the texts below the scatter, in limits, and where they end: far points are at EDGE, above them."""

_CIRCLE = np.linspace(0, 2 * math.pi, 73)


def begin_sky(stream: rr.RecordingStream, catalog: StarCatalog | None) -> None:
    """The catalogue on the unit sphere (ICRS axes) and the styles of the tracks."""
    if catalog is not None:
        shown = catalog.rows(slice(0, MAX_CATALOG_STARS))
        faintest = float(shown.magnitude.max(initial=0.0))
        radii = rr.Radius.ui_points(np.clip(0.6 + 0.5 * (faintest - shown.magnitude), 0.6, 4.0).tolist())
        stars = rr.Points3D(shown.icrs.astype(np.float32), radii=radii, colors=[GREY])
        stream.log("/sky/catalogue", stars, static=True)
    for kind, colour, width in (("true", VERMILLION, 3.0), ("measured", SKY_BLUE, 2.0)):
        style = rr.Points3D.from_fields(colors=[colour], radii=[rr.Radius.ui_points(width)])
        stream.log(f"/sky/{kind}", style, static=True)
    outline = rr.LineStrips3D.from_fields(colors=[YELLOW], radii=[rr.Radius.ui_points(1.0)])
    stream.log("/sky/field", outline, static=True)


def send_sky(stream: rr.RecordingStream, columns: NDArray[np.void], camera: Camera) -> None:
    """Measured and true boresights of some frames (rows of FRAME), and the field of view of the last of each row."""
    for kind, suffix in (("true", "_true_deg"), ("measured", "_deg")):
        known = np.isfinite(columns["ra" + suffix])
        if known.any():
            utc_ns, ra_deg, de_deg = (columns[name][known] for name in ("utc_ns", "ra" + suffix, "de" + suffix))
            ends, lengths = grouped(utc_ns)
            track = rr.Points3D.columns(positions=unit_vectors(ra_deg, de_deg).astype(np.float32)).partition(lengths)
            stream.send_columns(f"/sky/{kind}", [times(utc_ns[ends])], track)
    answered = np.flatnonzero(np.isfinite(columns["ra_deg"]))
    if len(answered):
        lasts = columns[answered[grouped(columns["utc_ns"][answered])[0]]]
        rotations = np.array([attitude.icrs_to_sensor for attitude in _attitudes_of(lasts)])
        fields = product(field_outline_sensor(camera), rotations).astype(np.float32)
        strips = rr.LineStrips3D.columns(strips=fields).partition(np.ones(len(fields), dtype=np.int64))
        stream.send_columns("/sky/field", [times(lasts["utc_ns"])], strips)


def grouped(utc_ns: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Frames (N,) in stretches of TRACK_ROW_NS: the last frame of each, and how many there are in each.

    Tracks and scatter get one row for each stretch: a row for each frame would be slow to draw over a long session.
    """
    stretch = (utc_ns - utc_ns[0]) // TRACK_ROW_NS
    ends = np.flatnonzero(np.append(np.diff(stretch) != 0, True))
    return ends, np.diff(ends, prepend=-1)


def _attitudes_of(frames: NDArray[np.void]) -> Iterator[Attitude]:
    """Of frames (rows of FRAME) with an answer, which may have no roll."""
    roll_deg = np.nan_to_num(frames["roll_deg"])
    for angles_deg in zip(frames["ra_deg"].tolist(), frames["de_deg"].tolist(), roll_deg.tolist(), strict=True):
        yield Attitude.from_angles(*angles_deg)


def unit_vectors(ra_deg: NDArray[np.float64], de_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors (N, 3) of right ascensions and declinations (N,)."""
    ra, de = np.radians(ra_deg), np.radians(de_deg)
    return np.column_stack([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])


def begin_scatter(stream: rr.RecordingStream, limits: Limits) -> None:
    """The box of the limits and the axes; rerun's pictures have no scales of their own."""
    x, y = limits.d_ra_cosde_arcsec, limits.d_de_arcsec
    box = [[-x, -y], [x, -y], [x, y], [-x, y], [-x, -y]]
    stream.log(
        "/scatter/limits",
        rr.LineStrips2D([box], colors=[VERMILLION], radii=[rr.Radius.ui_points(1.0)]),
        static=True,
    )
    axes = rr.LineStrips2D(
        [[[-x * EDGE, 0], [x * EDGE, 0]], [[0, -y * EDGE], [0, y * EDGE]]],
        colors=[PALE],
        radii=[rr.Radius.ui_points(0.5)],
    )
    stream.log("/scatter/axes", axes, static=True)
    names = rr.Points2D(
        [[x * 1.2, 0], [0, -y * 1.2], [0, y * _LEGEND[0]]],
        labels=["+dRA*", "+dDE", f"limits {x:g} x {y:g} arcsec"],
        colors=[GREY, GREY, VERMILLION],
        radii=[rr.Radius.ui_points(0.0)],
        show_labels=True,
    )
    stream.log("/scatter/names", names, static=True)
    points = rr.Points2D.from_fields(colors=[SKY_BLUE], radii=[rr.Radius.ui_points(1.5)])
    stream.log("/scatter/points", points, static=True)
    rings = rr.LineStrips2D.from_fields(colors=[GREEN], radii=[rr.Radius.ui_points(1.2)])
    stream.log("/scatter/rings", rings, static=True)
    place = [[0.0, _LEGEND[1] * limits.d_de_arcsec]]
    text = rr.Points2D(place, colors=[GREEN], radii=[rr.Radius.ui_points(0.0)], show_labels=True)
    stream.log("/scatter/sigma", text, static=True)


def send_scatter(
    stream: rr.RecordingStream, columns: NDArray[np.void], limits: Limits, errors: tuple[ErrorsSoFar, ErrorsSoFar]
) -> None:
    """dRA* to the right and dDE upwards of some frames, with rings of 1 and 3 sigma of ``errors`` about the mean."""
    found = columns[np.isfinite(columns[D_RA_COSDE.column])]
    if not len(found):
        return
    ends, lengths = grouped(found["utc_ns"])
    edge = EDGE * np.array([limits.of(axis) for axis in ON_SKY])
    # Rows of a picture go down, so the sign of dDE is turned.
    xy = np.column_stack([found[D_RA_COSDE.column], -found[D_DE.column]])
    points = np.round(np.clip(xy, -edge, edge), 3).astype(np.float32)
    rows = rr.Points2D.columns(positions=points).partition(lengths)
    stream.send_columns("/scatter/points", [times(found["utc_ns"][ends])], rows)
    rings = sigma_rings(*errors)
    if rings:
        at = times(found["utc_ns"][:1])
        columns = rr.LineStrips2D.columns(strips=[ring.astype(np.float32) for ring in rings])
        stream.send_columns("/scatter/rings", [at], columns.partition([len(rings)]))
        label = f"sigma {errors[0].std:.1f} x {errors[1].std:.1f}; rings: 1, 3 sigma"
        stream.send_columns("/scatter/sigma", [at], rr.Points2D.columns(labels=[label]).partition([1]))


def sigma_rings(d_ra: ErrorsSoFar, d_de: ErrorsSoFar) -> list[NDArray[np.float64]]:
    """Ellipses of 1 and 3 standard deviations about the mean, dDE upwards; none for fewer than two values."""
    if d_ra.n < 2:
        return []
    circle = np.column_stack([np.cos(_CIRCLE) * d_ra.std, np.sin(_CIRCLE) * d_de.std])
    return [circle * n + (d_ra.mean, -d_de.mean) for n in (1, 3)]
