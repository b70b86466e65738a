"""Progress of long work on stderr, with the time left."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from drivers.playback import is_session
from drivers.session_file.reader import messages
from drivers.session_file.records import RX
from gse.cli.options import say
from gse.config.choice import StationText
from gse.process.release_memory import spare_pandas
from gse.sessions.replay import Replay, ReplayOptions, replay_session
from gse.sessions.status_file import is_being_recorded
from gse.station.frame_results import FrameResults
from gse.station.loop import Listener, StationLoop

if TYPE_CHECKING:
    from gse.sessions.kept_results import Judged


# Progress of a long command on stderr with the time left: a bar on a terminal, else a line at each tenth.


class ProgressBar:
    """The progress of ``what``, with ``total`` parts; a part may have ended with an error."""

    def __init__(self, what: str, total: int) -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        self._what, self._errors = what, 0
        self._console = Console(stderr=True)
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        off = not self._console.is_terminal
        self._progress = Progress(*columns, console=self._console, transient=True, disable=off)
        self._task = self._progress.add_task(what, total=total)

    def __enter__(self) -> "ProgressBar":
        self._progress.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._progress.__exit__(*error)

    def advance(self, count: int = 1, *, is_error: bool = False) -> None:
        """Count parts that are done."""
        self._errors += is_error
        described = f"{self._what} ({self._errors} with errors)" if self._errors else self._what
        self._progress.update(self._task, advance=count, description=described)
        task = self._progress.tasks[0]
        done, total = int(task.completed), int(task.total or 0)
        if not self._console.is_terminal and done * 10 // total > (done - count) * 10 // total:
            left_s = task.time_remaining
            left = f", {time_left(left_s)} left" if left_s and done < total else ""
            click.echo(f"{described}: {done} of {total}{left}", err=True)


def time_left(seconds: float) -> str:
    """A time for a person: about 8 s, about 3 min."""
    return f"about {seconds:.0f} s" if seconds < 90 else f"about {seconds / 60:.0f} min"


def replay_with_progress(
    path: Path,
    make_listeners: Callable[[StationLoop], Sequence[Listener]] = lambda loop: (),
    options: ReplayOptions | None = None,
    station: Callable[[StationText], StationText] = lambda recorded: recorded,
) -> Replay:
    """Replay a session at full speed; a bar shows its progress where stderr is a terminal."""
    replayed = partial(replay_session, path, options=options or ReplayOptions(), station=station, tell=say)
    console = Console(stderr=True)
    if not console.is_terminal or not path.exists():
        return replayed(make_listeners=make_listeners)
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn  # for a terminal

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("replaying", total=_bytes_of(path))
        loops: list[StationLoop] = []

        def listeners_of(loop: StationLoop) -> Sequence[Listener]:
            loops.append(loop)
            return make_listeners(loop)

        def each(results: list[FrameResults]) -> None:
            progress.update(task, completed=loops[0].session.link.bytes_in)

        return replayed(make_listeners=listeners_of, each=each)


def judged_with_progress(
    path: Path,
    *,
    options: ReplayOptions | None = None,
    station: Callable[[StationText], StationText] = lambda recorded: recorded,
    anew: bool = False,
) -> "Judged":
    """A session and its assessment, from kept results or, with progress, derived; stderr says which.

    With options the session is another one: then results are neither used nor kept.
    """
    from gse.sessions.kept_results import Judged, judged_session

    spare_pandas()

    def derive() -> Replay:
        return replay_with_progress(path, options=options, station=station)

    if is_being_recorded(path):
        say(f"{path} is being recorded: this covers what there is so far")
    if options not in (None, ReplayOptions()):
        replay = derive()
        return Judged(replay.session, replay.own_elapsed_us)
    return judged_session(path, station=station, derive=derive, tell=say, anew=anew)


class ReplayedShare:
    """How far a replay with a status line of its own is: 43 % done, 12 s left."""

    def __init__(self, path: Path) -> None:
        from rich.progress import Progress  # 10 ms, which kept results need not wait

        shown = Console(stderr=True).is_terminal and path.exists()
        self._progress = Progress(disable=True)  # it counts, and another line shows it
        self._task = self._progress.add_task("", total=_bytes_of(path) if shown else 0)

    def text(self, replayed_bytes: int) -> str:
        """The words; empty where there is no terminal, or nothing was replayed yet."""
        self._progress.update(self._task, completed=replayed_bytes)
        task = self._progress.tasks[0]
        if not task.total or not replayed_bytes:
            return ""
        left_s = task.time_remaining
        left = f", {time_left(left_s).removeprefix('about ')} left" if left_s else ""
        return f"{task.percentage:.0f} % done{left}"


def _bytes_of(path: Path) -> int:
    """All received bytes of a recording."""
    if is_session(path):
        return sum(len(message.data) for message in messages(path, RX))
    return path.stat().st_size
