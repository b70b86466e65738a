"""Long lines for a terminal, folded between words; files and pipes get them whole."""

import shutil
import sys
import textwrap


def folded(text: str, *, indent: int = 0, err: bool = False) -> str:
    """``text`` for stdout, or stderr with ``err``: lines wider than the terminal go on below, ``indent`` columns in.

    A word that is wider than the terminal, such as a path, stays whole.
    """
    stream = sys.stderr if err else sys.stdout
    if stream is None or not stream.isatty():
        return text
    columns = shutil.get_terminal_size().columns
    return "\n".join(_folded(line, columns, indent) for line in text.split("\n"))


def _folded(line: str, columns: int, indent: int) -> str:
    if len(line) <= columns:
        return line
    pieces = textwrap.wrap(
        line, columns, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False
    )
    return "\n".join(pieces)
