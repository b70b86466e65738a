"""Hot pixels of a sensor over its nights: which are there, which were born, which are gone."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from drivers.chunk import LinkEvent
from gse.report.parquet import field
from gse.station.frame_results import FrameResults
from gse.station.non_stellar import HOT_PIXEL, MAX_HOT
from gse.station.session_data import SessionData

_PIXEL = pa.struct([field("x_px", pa.int32()), field("y_px", pa.int32()), field("frames", pa.int64())])
COLUMN = field("hot_pixels_seen", pa.list_(_PIXEL))
"""Column of the table of sessions: the pixels that were seen to be hot, with the number of frames."""


class HotPixelCounter:
    """Counts on which pixels the objects of a session are that do not move with the sky; a listener."""

    def __init__(self) -> None:
        self._frames: Counter[tuple[int, int]] = Counter()

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """Count the hot pixels of panoramas; only those that have some are made, which costs more than all the rest."""
        for place in np.flatnonzero(results.rows["hot_pixels"]).tolist():
            result = results[place]
            for row, kind in result.others:
                if kind == HOT_PIXEL:
                    x_px, y_px = result.panorama.xy_px[row]
                    self._frames[round(float(x_px)), round(float(y_px))] += 1

    def on_event(self, event: LinkEvent) -> None:
        """Events tell nothing of pixels."""

    def column(self) -> pa.Array:
        """The one value of COLUMN, the most frequent first."""
        seen = [{"x_px": x, "y_px": y, "frames": n} for (x, y), n in self._frames.most_common(MAX_HOT)]
        return pa.array([seen], COLUMN.type)


@dataclass(frozen=True, slots=True)
class HotPixel:
    """A pixel with the first and the last night on which it was hot, and the number of such nights.

    ``born`` where nights before the first had it not, ``gone`` where nights after the last have it not.
    """

    x_px: int
    y_px: int
    first_night: str
    last_night: str
    nights: int
    born: bool
    gone: bool


def hot_pixels(nights: Iterable[tuple[str, list[dict[str, int]] | None]]) -> list[HotPixel]:
    """From nights in their order, each with its value of COLUMN."""
    seen: dict[tuple[int, int], list[str]] = {}
    known: list[str] = []
    for night, pixels in nights:
        known.append(night)
        for pixel in pixels or ():
            of_pixel = seen.setdefault((pixel["x_px"], pixel["y_px"]), [])
            if night not in of_pixel[-1:]:
                of_pixel.append(night)
    return [
        HotPixel(x, y, of_pixel[0], of_pixel[-1], len(of_pixel), of_pixel[0] > known[0], of_pixel[-1] < known[-1])
        for (x, y), of_pixel in sorted(seen.items())
    ]
