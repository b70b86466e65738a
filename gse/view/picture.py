"""Picture of the panorama: its objects on the detector, as rerun columns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from gse.camera import Camera
from gse.catalog import StarCatalog
from gse.constants import ARCSEC_RAD
from gse.drawing.palette import GREY, ORANGE, PINK, SKY_BLUE, VERMILLION, YELLOW
from gse.station.non_stellar import HOT_PIXEL, UNKNOWN
from gse.station.results import FrameResult
from gse.view.series import times

RESIDUAL_SCALE = 100
"""Scale of the residual arrows."""

_KINDS = {"named": SKY_BLUE, "stars": SKY_BLUE, "unidentified": ORANGE, "hot": VERMILLION, "planets": PINK}
"""Kinds of objects, with their colours."""

_LABELLED = ("named", "hot", "planets")
"""In radians."""

_RADIUS_SHARE = (0.004, 0.012)
"""Radius of the dimmest and brightest object, as a share of the detector's width."""

LEGEND_ENDS = 1.2
"""Where the legend below the detector ends, as a share of its rows."""

_ANONYMOUS = ("Gaia", "HIP", "HR", "HD", "BSC")
"""Prefix of stars with a name on hover only: 30 catalogue numbers would cover the picture."""


@dataclass(frozen=True, slots=True)
class Picture:
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

    def send(self, stream: rr.RecordingStream, frames: Sequence[FrameResult]) -> None:
        """The objects of some frames: named stars, other stars, unidentified, hot pixels and planets apart."""
        panoramas = [frame.panorama for frame in frames]
        at = times([panorama.utc_ns for panorama in panoramas])
        xy_px = np.concatenate([panorama.xy_px for panorama in panoramas]).reshape(-1, 2).astype(np.float32)
        radii = self._radii(np.concatenate([panorama.brightness for panorama in panoramas]))
        row = np.repeat(np.arange(len(frames)), [len(panorama.brightness) for panorama in panoramas])
        objects = [_objects(frame, self.catalog) for frame in frames]
        kinds = np.array([kind for each in objects for kind in each.kinds], dtype=np.str_)
        labels = [label for each in objects for label in each.labels]
        facts = [fact for each in objects for fact in each.facts]
        stars = np.array([star for each in objects for star in each.stars], dtype=np.int64)
        for kind in _KINDS:
            # A named star is drawn as a star with its facts on hover; its name alone is the label that always shows, of
            # a point without size: rerun shows no facts of an entity with a single point, and none of six components.
            is_star = (kinds == "named") | (kinds == "stars")
            chosen = np.flatnonzero(is_star if kind == "stars" else kinds == kind)
            # By catalogue, brightest first: rerun knows a point under the mouse by its place among those of the frame
            # before, and in the order of a panorama it would tell the facts of another star.
            chosen = chosen[np.lexsort((stars[chosen], row[chosen]))]
            shown = facts if kind == "stars" else labels
            columns = rr.Points2D.columns(
                positions=xy_px[chosen],
                radii=radii[chosen] * (kind != "named"),
                labels=[shown[place] for place in chosen],
            )
            lengths = np.bincount(row[chosen], minlength=len(frames))
            stream.send_columns(f"/panorama/{kind}", [at], columns.partition(lengths))

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


@dataclass(frozen=True, slots=True)
class _Objects:
    """Kind, label, facts and row in the catalogue (-1: none) of each object of a frame."""

    kinds: list[str]
    labels: list[str]
    facts: list[str]
    stars: list[int]


def _objects(frame: FrameResult, catalog: StarCatalog | None) -> _Objects:
    """The objects of a frame, each with the name of its star or planet, or its class."""
    count = len(frame.panorama.brightness)
    objects = _Objects(["unidentified"] * count, [UNKNOWN] * count, [""] * count, [-1] * count)
    for row, name in frame.others:
        if name != UNKNOWN:
            objects.kinds[row], objects.labels[row] = "hot" if name == HOT_PIXEL else "planets", name
    for match, star in zip(frame.matches, frame.matches.stars.tolist(), strict=True):
        row, name = match.object, match.star
        magnitude = f", {catalog.magnitude[star]:.1f} mag" if catalog is not None else ""
        # Figures first: rerun shows 27 characters beside a star in the left half of the picture.
        objects.facts[row] = f"{match.residual_arcsec:.1f} arcsec{magnitude}, {name}"
        objects.kinds[row], objects.labels[row] = "stars" if name.startswith(_ANONYMOUS) else "named", name
        objects.stars[row] = star
    return objects
