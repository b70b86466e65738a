"""Pictures in rerun: objects of a panorama on the detector, the boresight's track on the sky, the scatter of errors."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from gse.catalog import StarCatalog
from gse.station.non_stellar import HOT_PIXEL, KINDS, UNKNOWN
from gse.values.attitude import Attitude
from gse.values.axis import D_DE, D_RA_COSDE, ON_SKY
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_RAD
from gse.values.instant import NS_PER_S
from gse.values.limits import Limits
from gse.values.matrices import product
from gse.view.drawing import GREEN, GREY, ORANGE, PALE, PINK, SKY_BLUE, VERMILLION, YELLOW, field_outline_sensor
from gse.view.live_state import ErrorsSoFar
from gse.view.series import EDGE, times

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
