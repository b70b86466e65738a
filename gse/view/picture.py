"""Picture of the panorama: its objects on the detector, as rerun columns."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from gse.catalog import StarCatalog
from gse.station.non_stellar import HOT_PIXEL, KINDS, UNKNOWN
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_RAD
from gse.view.drawing import GREY, ORANGE, PINK, SKY_BLUE, VERMILLION, YELLOW
from gse.view.series import times

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
