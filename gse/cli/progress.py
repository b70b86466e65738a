"""Progress of long work on stderr, with the time left."""

from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from drivers.mock.playback import is_session
from drivers.session_file.reader import messages
from drivers.session_file.records import RX
from gse.sessions.replay import Cut, Replay, replay_session
from gse.station.loop import Sink, StationLoop
from gse.station.results import FrameResult

SinkMaker = Callable[[StationLoop, Path | None], Sequence[Sink]]


def replay_with_progress(path: Path, make_sinks: SinkMaker = lambda loop, folder: (), cut: Cut | None = None) -> Replay:
    """Replay a session at full speed; a bar shows its progress where stderr is a terminal."""
    cut = cut or Cut()
    console = Console(stderr=True)
    if not console.is_terminal or not path.exists():
        return replay_session(path, cut=cut, make_sinks=make_sinks)
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("replaying", total=_bytes_of(path))
        loops: list[StationLoop] = []

        def sinks_of(loop: StationLoop, folder: Path | None) -> Sequence[Sink]:
            loops.append(loop)
            return make_sinks(loop, folder)

        def each(results: list[FrameResult]) -> None:
            progress.update(task, completed=loops[0].night.link.bytes_in)

        return replay_session(path, cut=cut, make_sinks=sinks_of, each=each)


def _bytes_of(path: Path) -> int:
    """All received bytes of a recording."""
    if is_session(path):
        return sum(len(message.data) for message in messages(path, RX))
    return path.stat().st_size
