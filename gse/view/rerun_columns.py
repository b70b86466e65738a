"""The frames of a session as rerun columns: graphs over time, the detector, the sky, the scatter of errors."""

import math
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from drivers.clock import ClockReading
from gse.catalog import StarCatalog
from gse.station.columns import COLUMNS, Column, unit_of
from gse.station.non_stellar import HOT_PIXEL, KINDS, UNKNOWN
from gse.values.attitude import Attitude
from gse.values.axis import D_DE, D_RA_COSDE, D_ROLL, ON_SKY
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_RAD
from gse.values.instant import NS_PER_S
from gse.values.limits import Limits
from gse.values.matrices import product
from gse.view.drawing import BLUE, GREEN, GREY, ORANGE, PALE, PINK, SKY_BLUE, VERMILLION, YELLOW, field_outline_sensor
from gse.view.live_state import ErrorsSoFar

TIMELINE = "utc"
EDGE = 1.4
"""Points outside the limits are drawn at this many limits at most: one false answer is off by degrees."""

OUTAGE_NS = 3 * NS_PER_S
"""Longest time without a frame over which a line is drawn."""

_PATHS = {"d_ra": D_RA_COSDE, "d_de": D_DE}
"""The series that have a limit."""

NEAR = np.dtype([("utc_ns", "i8"), *((path, "f8", 4) for path in _PATHS)])
"""Of a frame the error where it is within its limit, running mean, and mean less and plus a standard deviation."""

OWN_PATHS = {
    "/sensor/d_ra": D_RA_COSDE.column,
    "/sensor/d_de": D_DE.column,
    "/sensor/roll": D_ROLL.column,
    "/sensor/latency_ms": "latency_ms",
}
"""The series of the sensor's own answers, beside those of the identifier under test."""

GRAPHS: dict[str, list[Column]] = {}
"""The columns that are drawn, by graph."""
for _column in COLUMNS:
    if _column.graph:
        GRAPHS.setdefault(_column.graph, []).append(_column)
_COLOURS = {
    "temperature_c": (ORANGE,),
    "identification_ms": (GREEN,),
    "roll": (PINK,),
    "stars": (SKY_BLUE, YELLOW),
}
_OTHER_COLOURS = (SKY_BLUE, ORANGE, YELLOW, PINK, GREEN)
"""Colours of the lines of a graph that has none of its own."""

_DECIMALS = 3
"""Milliarcseconds, microseconds: rerun's tooltips print every digit there is."""


MEAN_S = 20.0
"""The window of the running mean: longer than the noise of a star, shorter than what happens to a mount."""


def times(utc_ns: Sequence[int] | NDArray[np.int64]) -> rr.TimeColumn:
    """The time column of instants in UTC nanoseconds."""
    return rr.TimeColumn(TIMELINE, timestamp=np.asarray(utc_ns, dtype=np.int64).astype("datetime64[ns]"))


_ITEM_COLOURS = (SKY_BLUE, ORANGE, YELLOW, VERMILLION, BLUE, PALE)


def begin_series(stream: rr.RecordingStream) -> None:
    """Names, colours and widths of every series; they hold for the whole recording."""
    for path in _PATHS:
        _lines(stream, f"/{path}/value", ["value", "limit", "limit"], [SKY_BLUE, VERMILLION, VERMILLION])
        points = rr.SeriesPoints(colors=[VERMILLION], markers=["cross"], names=["outside limit"], marker_sizes=[5.0])
        stream.log(f"/{path}/outside", points, static=True)
        names = ["error", "mean of 20 s", "- sigma", "+ sigma"]
        _lines(stream, f"/near/{path}", names, [PALE, SKY_BLUE, BLUE, BLUE], [1.0, 3.0, 1.0, 1.0])
    for path, columns in GRAPHS.items():
        colours = list(_COLOURS.get(path, _OTHER_COLOURS))[: len(columns)]
        _lines(stream, f"/{path}", [column.line or column.name for column in columns], colours)
    for path in ("/sensor/d_ra", "/sensor/d_de", "/near/d_ra/own", "/near/d_de/own"):
        _lines(stream, path, ["sensor's own"], [ORANGE])
    _lines(stream, "/sensor/roll", ["sensor's own"], [YELLOW])
    _lines(stream, "/sensor/latency_ms", ["sensor's own"], [ORANGE])
    _lines(stream, "/clock", ["offset", "+ error bound", "- error bound"], [BLUE, GREY, GREY])


def _lines(
    stream: rr.RecordingStream,
    path: str,
    names: list[str],
    colours: list[tuple[int, int, int]],
    widths: Sequence[float] = (),
) -> None:
    widths = widths or [1.5] * len(names)
    lines = rr.SeriesLines(names=names, colors=colours, widths=widths, aggregation_policy="MinMax")
    stream.log(path, lines, static=True)


def near_rows(columns: NDArray[np.void], limits: Limits, latest: int | None = None) -> NDArray[np.void]:
    """Rows of NEAR of the ``latest`` frames, or of all; the mean is of errors cut at EDGE limits."""
    rows = np.zeros(len(columns), NEAR)
    rows["utc_ns"] = columns["utc_ns"]
    begin_ns = np.maximum.accumulate(columns["utc_ns"]) - round(MEAN_S * NS_PER_S)
    begins = np.searchsorted(np.maximum.accumulate(columns["utc_ns"]), begin_ns, "right")
    for path, axis in _PATHS.items():
        edge = EDGE * limits.of(axis)
        errors = np.clip(columns[axis.column].astype(np.float64), -edge, edge)
        known = np.isfinite(errors)
        sums = [
            np.append(0.0, np.cumsum(part))
            for part in (known, np.where(known, errors, 0), np.where(known, errors**2, 0))
        ]
        count, total, squares = (one[1:] - one[begins] for one in sums)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.where(known, total / count, np.nan)
            sigma = np.sqrt(np.maximum(squares / count - mean**2, 0))
        near = np.where(np.abs(errors) <= limits.of(axis), errors, np.nan)  # one far off would flatten all others
        rows[path] = np.column_stack([near, mean, mean - sigma, mean + sigma])
    return rows if latest is None else rows[len(rows) - latest :].copy()  # who keeps it keeps nothing else


def send_near(stream: rr.RecordingStream, rows: NDArray[np.void]) -> None:
    """The errors close up, with running mean and band, rows of NEAR."""
    for path in _PATHS:
        _send(stream, f"/near/{path}", times(rows["utc_ns"]), rows[path])


def send_series(stream: rr.RecordingStream, columns: NDArray[np.void], limits: Limits) -> None:
    """All series of some frames (rows of FRAME); frames without a value leave a gap."""
    utc_ns = columns["utc_ns"]
    at = times(utc_ns)
    for path, axis in _PATHS.items():
        values, limit = columns[axis.column], limits.of(axis)
        bounds = np.full((len(values), 2), limit) * (1, -1)
        _send(stream, f"/{path}/value", at, np.column_stack([values, bounds]))
        outside = np.flatnonzero(np.abs(values) > limit)
        if len(outside):
            edge = np.clip(values[outside], -EDGE * limit, EDGE * limit)
            _send(stream, f"/{path}/outside", times(utc_ns[outside]), edge[:, None])
    for path, drawn in GRAPHS.items():
        scale = 1000 if unit_of(path) == "ms" else 1  # of columns in microseconds
        _send(stream, f"/{path}", at, _stacked(columns, *(column.name for column in drawn)) / scale)


def send_own_answers(stream: rr.RecordingStream, errors: NDArray[np.void], limits: Limits) -> None:
    """The series of the sensor's own answers, rows of OWN_ERROR; a gap where it has none, or was silent."""
    utc_ns = errors["utc_ns"]
    silent = np.flatnonzero(np.diff(utc_ns) > OUTAGE_NS)
    for path, name in OWN_PATHS.items():
        _send(stream, path, times(utc_ns), _stacked(errors, name))
        if len(silent):
            _send(stream, path, times(utc_ns[silent] + 1), np.full((len(silent), 1), np.nan))
    for path, axis in _PATHS.items():
        values = _stacked(errors, axis.column)
        near = np.where(np.abs(values) <= limits.of(axis), values, np.nan)
        _send(stream, f"/near/{path}/own", times(utc_ns), near)


def begin_item(stream: rr.RecordingStream, graph: int, name: str) -> None:
    """Name and colour of an item of housekeeping, in the graph of its unit."""
    colour = _ITEM_COLOURS[zlib.crc32(name.encode()) % len(_ITEM_COLOURS)]
    _lines(stream, f"/housekeeping/{graph}/{name}", [name], [colour])


def send_item(
    stream: rr.RecordingStream, graph: int, name: str, utc_ns: NDArray[np.int64], values: NDArray[np.float64]
) -> None:
    """The values (N,) of an item of housekeeping that has begun."""
    _send(stream, f"/housekeeping/{graph}/{name}", times(utc_ns), values[:, None])


def send_outages(stream: rr.RecordingStream, utc_ns: NDArray[np.int64], limits: Limits) -> None:
    """Break the lines of all series where no frames came, right after the last frames before (their instants, (M,))."""
    at, nothing = times(utc_ns + 1), np.full((len(utc_ns), 1), np.nan)
    for path, axis in _PATHS.items():
        bounds = np.full((len(utc_ns), 2), limits.of(axis)) * (1, -1)
        _send(stream, f"/{path}/value", at, np.column_stack([nothing, bounds]))
        _send(stream, f"/near/{path}", at, np.repeat(nothing, 4, axis=1))
    for path, drawn in GRAPHS.items():
        _send(stream, f"/{path}", at, np.repeat(nothing, len(drawn), axis=1))


def _stacked(columns: NDArray[np.void], *names: str) -> NDArray[np.float64]:
    return np.column_stack([columns[name].astype(np.float64) for name in names])


def send_clock(stream: rr.RecordingStream, readings: Sequence[ClockReading]) -> None:
    """Offset of the host clock and its error bound, in milliseconds."""
    rows = [(r.offset_s, r.error_bound_s, -r.error_bound_s) for r in readings]
    _send(stream, "/clock", times([r.utc_ns for r in readings]), np.array(rows) * 1000)


def _send(stream: rr.RecordingStream, path: str, at: rr.TimeColumn, rows: NDArray[np.float64]) -> None:
    values = np.round(rows, _DECIMALS)
    columns = rr.Scalars.columns(scalars=values.ravel()).partition(np.full(len(values), values.shape[1]))
    stream.send_columns(path, [at], columns)


# The panorama: its objects on the detector.

RESIDUAL_SCALE = 100
"""Scale of the residual arrows."""

_KINDS = {"named": SKY_BLUE, "stars": SKY_BLUE, "unidentified": ORANGE, "hot": VERMILLION, "planets": PINK}
"""Kinds of objects, with their colours."""

_KIND = "U12"
_LABELLED = ("named", "hot", "planets")
"""The kinds whose labels show without the mouse."""

_RADIUS_SHARE = (0.004, 0.012)
"""Radius of the dimmest and brightest object, as a share of the detector's width."""

LEGEND_ENDS = 1.2
"""Where the legend below the detector ends, as a share of its rows."""

_ANONYMOUS = ("Gaia", "HIP", "HR", "HD", "BSC")
"""Prefix of stars with a name on hover only: 30 catalogue numbers would cover the picture."""


@dataclass(frozen=True, slots=True)
class DetectorPicture:
    """The detector of a station."""

    camera: Camera
    index_max: int
    catalog: StarCatalog | None = None

    def begin(self, stream: rr.RecordingStream) -> None:
        """The frame of the detector, its principal point, and how each kind of object looks.

        Objects with names are labelled, catalogue numbers show on hover.
        """
        right, bottom = self.camera.columns - 0.5, self.camera.rows - 0.5
        outline = [[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom], [-0.5, -0.5]]
        x, y = self.camera.principal_point_px
        arm = self.camera.columns / 60
        cross = [[[x - arm, y], [x + arm, y]], [[x, y - arm], [x, y + arm]]]
        strips = rr.LineStrips2D([outline, *cross], colors=[GREY], radii=[rr.Radius.ui_points(0.7)])
        stream.log("/panorama/detector", strips, static=True)
        for kind, colour in _KINDS.items():
            style = rr.Points2D.from_fields(colors=[colour], show_labels=kind in _LABELLED)
            stream.log(f"/panorama/{kind}", style, static=True)
        arrows = rr.Arrows2D.from_fields(colors=[YELLOW], radii=[rr.Radius.ui_points(0.8)])
        stream.log("/panorama/residuals", arrows, static=True)
        stream.log("/panorama/legend", self._legend(), static=True)

    def _legend(self) -> rr.Points2D:
        """The meaning of the colours below the detector, where no title can be cut."""
        words = ("star", "unidentified", "hot pixel", "planet", f"arrow: residual x {RESIDUAL_SCALE}")
        colours = (SKY_BLUE, ORANGE, VERMILLION, PINK, YELLOW)
        # In two rows: a label is as wide as its text, whatever the size of the view.
        columns, rows = self.camera.columns, self.camera.rows
        places = [(0.14, 1.05), (0.5, 1.05), (0.86, 1.05), (0.2, 1.12), (0.68, 1.12)]
        return rr.Points2D(
            [(x * columns, y * rows) for x, y in places],
            labels=list(words),
            colors=list(colours),
            radii=[rr.Radius.ui_points(3.0)],
            show_labels=True,
        )

    def send(
        self,
        stream: rr.RecordingStream,
        columns: NDArray[np.void],
        matches: NDArray[np.void],
        others: NDArray[np.void],
        name_of: Callable[[int], str],
    ) -> None:
        """The objects of some frames: named stars, other stars, unidentified, hot pixels and planets apart.

        Frames are rows of FRAME; rows of MATCH and OTHER count them from the first of these. ``name_of`` knows the
        stars.
        """
        at, matches = times(columns["utc_ns"]), matches[matches["named"]]
        row = np.concatenate([matches["frame"], others["frame"]])
        xy_px = np.concatenate([_xy_px(matches), _xy_px(others)])
        radii = self._radii(np.concatenate([matches["brightness"], others["brightness"]]))
        stars = np.concatenate([matches["star"], np.full(len(others), -1)])
        objects = [self._of_stars(matches, name_of), _of_others(others)]
        kinds = np.concatenate([each.kinds for each in objects])
        labels = [label for each in objects for label in each.labels]
        facts = [fact for each in objects for fact in each.facts]
        for kind in _KINDS:
            # A named star is drawn as a star with its facts on hover; its name alone is the label that always shows, of
            # a point without size: rerun shows no facts of an entity with a single point, and none of six components.
            is_star = (kinds == "named") | (kinds == "stars")
            chosen = np.flatnonzero(is_star if kind == "stars" else kinds == kind)
            # By catalogue, brightest first: rerun knows a point under the mouse by its place among those of the frame
            # before, and in the order of a panorama it would tell the facts of another star.
            chosen = chosen[np.lexsort((stars[chosen], row[chosen]))]
            shown = facts if kind == "stars" else labels
            points = rr.Points2D.columns(
                positions=xy_px[chosen],
                radii=radii[chosen] * (kind != "named"),
                labels=[shown[place] for place in chosen.tolist()],
            )
            lengths = np.bincount(row[chosen], minlength=len(columns))
            stream.send_columns(f"/panorama/{kind}", [at], points.partition(lengths))

    def _of_stars(self, matches: NDArray[np.void], name_of: Callable[[int], str]) -> "_Objects":
        """Stars, each with its name, and with its residual."""
        stars, places = np.unique(matches["star"], return_inverse=True)
        names = [name_of(star) for star in stars.tolist()]
        magnitudes = ["" if self.catalog is None else f", {self.catalog.magnitude[star]:.1f} mag" for star in stars]
        kinds = np.array(["stars" if name.startswith(_ANONYMOUS) else "named" for name in names], dtype=_KIND)
        residuals_arcsec = np.hypot(matches["residual_x_arcsec"], matches["residual_y_arcsec"]).tolist()
        # Figures first: rerun shows 27 characters beside a star in the left half of the picture.
        facts = [
            f"{residual_arcsec:.1f} arcsec{magnitudes[place]}, {names[place]}"
            for residual_arcsec, place in zip(residuals_arcsec, places.tolist(), strict=True)
        ]
        return _Objects(kinds[places], [names[place] for place in places.tolist()], facts)

    def _radii(self, brightness: NDArray[np.float64]) -> NDArray[np.float32]:
        share = np.sqrt(np.clip(brightness / self.index_max, 0, 1))
        low, high = _RADIUS_SHARE
        return (self.camera.columns * (low + (high - low) * share)).astype(np.float32)

    def send_residuals(self, stream: rr.RecordingStream, columns: NDArray[np.void], matches: NDArray[np.void]) -> None:
        """Residuals of identified objects as arrows: frames as rows of FRAME, and their rows of MATCH."""
        lengths = np.bincount(matches["frame"], minlength=len(columns))
        origins = np.column_stack([matches["x_px"], matches["y_px"]])
        arcsec = np.column_stack([matches["residual_x_arcsec"], matches["residual_y_arcsec"]])
        vectors = arcsec * (RESIDUAL_SCALE * ARCSEC_RAD / self.camera.pixel_rad)
        if self.camera.mirrored:
            vectors[:, 0] = -vectors[:, 0]
        arrows = rr.Arrows2D.columns(origins=origins, vectors=vectors.astype(np.float32))
        stream.send_columns("/panorama/residuals", [times(columns["utc_ns"])], arrows.partition(lengths))


@dataclass(frozen=True, slots=True, eq=False)
class _Objects:
    """Kind, label and facts of each object."""

    kinds: NDArray[np.str_]
    labels: list[str]
    facts: list[str]


def _of_others(others: NDArray[np.void]) -> _Objects:
    """Objects without a star, each with its class, or with the name of its planet."""
    kind_of = ["unidentified" if name == UNKNOWN else "hot" if name == HOT_PIXEL else "planets" for name in KINDS]
    labels = [KINDS[kind] for kind in others["kind"].tolist()]
    return _Objects(np.array(kind_of, dtype=_KIND)[others["kind"]], labels, [""] * len(others))


def _xy_px(rows: NDArray[np.void]) -> NDArray[np.float32]:
    return np.column_stack([rows["x_px"], rows["y_px"]])


# The track of the boresight on the celestial sphere, and the scatter of dRA* and dDE.

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
