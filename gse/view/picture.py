"""The panorama as a picture: its objects on the detector, as rerun columns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from gse.camera import Camera
from gse.results import FrameResult
from gse.view.palette import GREY, ORANGE, PINK, SKY_BLUE, VERMILLION, YELLOW
from gse.view.series import times

RESIDUAL_SCALE = 100
"""Residual arrows are drawn this many times as long as they are."""

_KINDS = ("named", "stars", "unidentified", "hot", "planets")
_LABELLED = ("named", "hot", "planets")
_COLOURS = {"named": SKY_BLUE, "stars": SKY_BLUE, "unidentified": ORANGE, "hot": VERMILLION, "planets": PINK}
ARCSEC = np.pi / (180 * 3600)
"""In radians."""

_RADIUS_SHARE = (0.004, 0.012)
"""Radius of the dimmest and brightest object, as a share of the detector's width."""

_ANONYMOUS = ("Gaia", "HIP", "HR", "HD", "BSC")
"""A star whose name begins so is named on hover only: 30 catalogue numbers would cover the picture."""


@dataclass(frozen=True, slots=True)
class Picture:
    """The detector of a station."""

    camera: Camera
    index_max: int

    def begin(self, stream: rr.RecordingStream) -> None:
        """The frame of the detector, its principal point, and how each kind of object looks.

        What has a name is labelled, catalogue numbers show on hover.
        """
        right, bottom = self.camera.columns - 0.5, self.camera.rows - 0.5
        outline = [[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom], [-0.5, -0.5]]
        x, y = self.camera.principal_point_px
        arm = self.camera.columns / 60
        cross = [[[x - arm, y], [x + arm, y]], [[x, y - arm], [x, y + arm]]]
        strips = rr.LineStrips2D([outline, *cross], colors=[GREY], radii=[rr.Radius.ui_points(0.7)])
        stream.log("/panorama/detector", strips, static=True)
        for kind in _KINDS:
            style = rr.Points2D.from_fields(colors=[_COLOURS[kind]], show_labels=kind in _LABELLED)
            stream.log(f"/panorama/{kind}", style, static=True)
        arrows = rr.Arrows2D.from_fields(colors=[YELLOW], radii=[rr.Radius.ui_points(0.8)])
        stream.log("/panorama/residuals", arrows, static=True)

    def send(self, stream: rr.RecordingStream, frames: Sequence[FrameResult]) -> None:
        """The objects of some frames: identified, unidentified, hot and planets apart, and residual arrows."""
        at = times([frame.panorama.utc_ns for frame in frames])
        sorted_objects = [_objects_by_kind(frame) for frame in frames]
        for kind in _KINDS:
            self._send_kind(stream, at, frames, [objects[kind] for objects in sorted_objects], kind)
        self._send_arrows(stream, at, frames)

    def _send_kind(
        self,
        stream: rr.RecordingStream,
        at: rr.TimeColumn,
        frames: Sequence[FrameResult],
        chosen: list[dict[int, str]],
        kind: str,
    ) -> None:
        lengths = [len(objects) for objects in chosen]
        xy = [frame.panorama.xy_px[list(objects)] for frame, objects in zip(frames, chosen, strict=True)]
        radii = [self._radii(frame, objects) for frame, objects in zip(frames, chosen, strict=True)]
        columns = rr.Points2D.columns(
            positions=np.concatenate(xy).reshape(-1, 2).astype(np.float32),
            radii=np.concatenate(radii).astype(np.float32),
            labels=[text for objects in chosen for text in objects.values()],
        )
        stream.send_columns(f"/panorama/{kind}", [at], columns.partition(lengths))

    def _radii(self, frame: FrameResult, objects: dict[int, str]) -> NDArray[np.float64]:
        share = np.sqrt(np.clip(frame.panorama.index[list(objects)] / self.index_max, 0, 1))
        low, high = _RADIUS_SHARE
        return self.camera.columns * (low + (high - low) * share)

    def _send_arrows(self, stream: rr.RecordingStream, at: rr.TimeColumn, frames: Sequence[FrameResult]) -> None:
        residuals = [residual_px(frame, self.camera) for frame in frames]
        columns = rr.Arrows2D.columns(
            origins=np.concatenate([place for place, _ in residuals]).astype(np.float32),
            vectors=np.concatenate([arrow for _, arrow in residuals]).astype(np.float32) * RESIDUAL_SCALE,
        )
        stream.send_columns("/panorama/residuals", [at], columns.partition([len(place) for place, _ in residuals]))


def residual_px(frame: FrameResult, camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places (M, 2) of a frame's identified objects, and their residuals (M, 2) along columns and rows, in pixels."""
    places = frame.panorama.xy_px[[match.object for match in frame.matches]].reshape(-1, 2)
    arcsec = np.array([(m.residual_x_arcsec, m.residual_y_arcsec) for m in frame.matches]).reshape(-1, 2)
    pixels = arcsec * ARCSEC / camera.pixel_rad
    return places, pixels * (-1, 1) if camera.mirrored else pixels


def _objects_by_kind(frame: FrameResult) -> dict[str, dict[int, str]]:
    """Objects of each kind with their labels."""
    kinds: dict[str, dict[int, str]] = {kind: {} for kind in _KINDS}
    stars = {match.object: match.star for match in frame.matches}
    others = dict(frame.others)
    for row in range(len(frame.panorama.index)):
        if row in stars:
            kinds["stars" if stars[row].startswith(_ANONYMOUS) else "named"][row] = stars[row]
        else:
            name = others.get(row, "unknown")
            kinds[_kind_of(name)][row] = name
    return kinds


def _kind_of(name: str) -> str:
    if name == "hot pixel":
        return "hot"
    return "unidentified" if name == "unknown" else "planets"
