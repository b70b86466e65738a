"""A sign of life on the terminal while long work has no progress to show."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.live import Live
from rich.spinner import Spinner


@contextmanager
def working(text: str) -> Iterator[None]:
    """Show ``text`` and a moving mark on stderr, where that is a terminal; results stay on stdout."""
    console = Console(stderr=True, highlight=False)
    if not console.is_terminal:
        yield
        return
    with Live(Spinner("dots", text), console=console, transient=True, redirect_stdout=False):
        yield
