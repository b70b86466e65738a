"""Results that are made one by one, as a session holds them."""

from gse.station.frame_results import FrameResults
from gse.station.frame_table import FrameTable
from gse.station.results import FrameResult


def add_frame(frames: FrameTable, frame: FrameResult) -> None:
    """Add one result to the frames of a session."""
    results = FrameResults.of([frame])
    frames.extend(results.rows(), results.match_rows())
