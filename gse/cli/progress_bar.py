"""Progress of a long command on stderr with the time left: a bar on a terminal, else a line at each tenth."""

from typing import Any

import click


class ProgressBar:
    """The progress of ``what``, with ``total`` parts; a part may have ended with an error."""

    def __init__(self, what: str, total: int) -> None:
        from rich.console import Console
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
