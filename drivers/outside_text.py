"""Sanitised text from outside, for a terminal, a page or a table.

Whatever a sensor, a file or a server says goes through here before it is shown: a control character (ESC, C1, a change
of writing direction), a lone surrogate, or what no XML file may hold (U+FFFE) becomes its escape. The last door is that
of the terminal itself (gse/process/terminal.py): there the colours and cursor movements of the program pass, too.
"""

import re

MAX_CHARACTERS = 1000
_UNFIT = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]")
_STEERING = re.compile(rf"\x1b\[[0-9;?]*[A-Za-z]|[\n\r\t]|({_UNFIT.pattern})")
_PASSWORD = re.compile(r"(?<=://)([^/\s:@]*):[^/\s@]*@")
_FORMULA = ("=", "+", "-", "@")


def without_password(text: str) -> str:
    """The text with *** in the place of the password of each URL in it."""
    return _PASSWORD.sub(r"\1:***@", text)


def plain_line(text: str) -> str:
    """The text in one line, at most MAX_CHARACTERS of it, without passwords and what steers the thing that shows it."""
    text = without_password(text)
    shown = _UNFIT.sub(_escape, text[: MAX_CHARACTERS + 1])
    return shown if len(text) <= MAX_CHARACTERS else shown[:MAX_CHARACTERS] + " ..."


def plain_lines(text: str) -> str:
    """The same of any length, its line ends and tabs kept."""
    kept = without_password(text)
    return _UNFIT.sub(lambda found: found[0] if found[0] in "\n\t" else _escape(found), kept)


def terminal_text(text: str) -> str:
    """What a program prints: the escapes for colours and the cursor pass, and nothing else that steers a terminal."""
    return _STEERING.sub(lambda found: _escape(found) if found[1] else found[0], text)


def is_plain(text: str) -> bool:
    """Whether there is nothing in a text that steers what shows it."""
    return _UNFIT.search(text) is None


def table_cell(text: str) -> str:
    """The text for a CSV field: a spreadsheet takes what begins with = + - or @ for a formula, and runs it."""
    return _no_formula(plain_line(text))


def long_table_cell(text: str) -> str:
    """The same of any length and number of lines."""
    return _no_formula(plain_lines(text))


def _no_formula(text: str) -> str:
    return f"'{text}" if text.lstrip().startswith(_FORMULA) else text


def _escape(found: re.Match[str]) -> str:
    code = ord(found[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
