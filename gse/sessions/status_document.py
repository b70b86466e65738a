"""The document of status.json as others read it: checked, since a session folder may come from anybody."""

import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from drivers.outside_text import plain_line
from gse import instant

SCHEMA = "gse.status/1"
NAME = "status.json"
_MOST_BYTES = 64 << 10
_LARGEST = 1 << 62


def _instant(text: str) -> str:
    return instant.to_text(instant.from_text(text), 1)


_Line = Annotated[str, AfterValidator(plain_line)]
_Instant = Annotated[str, AfterValidator(_instant)]
_Count = Annotated[int, Field(ge=0, le=_LARGEST)]
_Number = Annotated[float, Field(allow_inf_nan=False)]
_Process = Annotated[int, Field(gt=1, lt=1 << 31)]
"""A signal to 1 or less goes to init, or to many processes at once."""


class _Status(BaseModel):
    """The keys that are read; others are left out. Earlier versions of gse wrote fewer."""

    model_config = ConfigDict(strict=True)

    schema_name: Literal["gse.status/1"] = Field(alias="schema")
    state: Literal["starting", "running", "closing", "reporting", "ended"]
    utc: _Instant = instant.to_text(0, 1)
    pid: _Process
    process: _Line | None
    port: _Line = ""
    link: _Line = ""
    frames: _Count = 0
    frames_lost: _Count = 0
    frames_per_s: _Number | None = None
    identified: _Number | None = None
    last_answer_utc: _Instant | None = None
    sky: _Line | None = None
    so_far: _Line = ""
    forecast: _Line | None = None
    page: _Line | None = None
    session_bytes: _Count = 0
    disk_free_bytes: _Count = 0
    verdict: _Line | None = None
    exit_code: int | None = None


def read_status(folder: Path) -> dict[str, Any] | None:
    """The status of a session folder; None where it is missing, unreadable, or not of gse."""
    path = folder / NAME
    if not path.is_file():  # nobody writes into a pipe in its place
        return None
    try:
        with path.open("rb") as file:
            document = json.loads(file.read(_MOST_BYTES))
        return _Status.model_validate(document).model_dump(by_alias=True)
    except (OSError, ValueError, RecursionError, ValidationError):
        return None
