"""Answers of an external identifier, schema gse.answer/1.

An answer has RA and DE, or a quaternion with its convention, or says that there is none. All numbers are checked here,
so that no NaN and no RA of 400 deg goes further.
"""

import json
import math
import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from drivers.outside_text import plain_line
from gse.values.attitude import Attitude

SCHEMA = "gse.answer/1"
MOST_DETAIL = 200
_NORM_WITHIN = 1e-3
"""A quaternion in single precision is a unit to 1e-7; one in whole thousandths to this."""

_KEYS = frozenset(
    (
        *("frame_no", "status", "detail", "ra_deg", "de_deg", "roll_deg"),
        *("quaternion", "order", "maps", "matches", "elapsed_us", "call_us"),
    )
)
_NUMBERS = (int, float)
_STAR = re.compile("-?[0-9]{1,19}")
_SCALAR_FIRST, _SCALAR_LAST = "scalar-first", "scalar-last"
_TO_SENSOR, _TO_ICRS = "icrs-to-sensor", "sensor-to-icrs"


_IDENTIFIED = "IDENTIFIED"
NO_ANSWER = ("TOO_FEW", "NO_MATCH", "AMBIGUOUS", "SENSOR_FAULT")
"""Numbers beside these are what was left in their place."""
_NONE = np.zeros(0, np.int64)


class FailureKind(StrEnum):
    """How an external identifier failed on a panorama."""

    CRASH = "CRASH"
    """It ended, or closed its output."""
    TIMEOUT = "TIMEOUT"
    FLOOD = "FLOOD"
    """A line longer than any answer."""
    NONSENSE = "NONSENSE"
    """No answer to this panorama: not JSON, not in the schema, or a number out of range."""
    START = "START"
    """It could not be started."""
    GIVEN_UP = "GIVEN_UP"
    """It failed so often in a row that it is not started again."""
    NOT_RECORDED = "NOT_RECORDED"
    """A replay of recorded answers found none."""


@dataclass(frozen=True, slots=True)
class Failure:
    """Why there is no answer to a panorama; ``in_step`` where the next line still belongs to the next panorama."""

    kind: FailureKind
    detail: str
    in_step: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class ExternalAnswer:
    """An answer: an attitude, or None with status and detail.

    ``document`` is the answer as it came, of the known keys. ``has_roll`` is False for RA and DE alone. ``objects``
    (M,) are rows of the panorama as it was sent, ``star_ids`` (M,) numbers in the station's catalogue. ``elapsed_us``
    is the time by the identifier's own clock, None where it states none; ``call_us`` that of the call, where a process
    of the station makes it.
    """

    document: dict[str, Any]
    attitude: Attitude | None
    has_roll: bool
    status: str
    detail: str
    objects: NDArray[np.int64]
    star_ids: NDArray[np.int64]
    elapsed_us: float | None
    call_us: float | None = None

    @property
    def stars_named(self) -> int:
        """Stars that it names; beside an answer that is none they do not count."""
        return len(self.star_ids) if self.attitude is not None else 0


def parse_line(line: bytes, frame_no: int, objects: int) -> ExternalAnswer | Failure:
    """The answer in a line of JSON to the panorama ``frame_no`` of so many objects."""
    try:
        document = _DECODER.decode(line.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        return Failure(FailureKind.NONSENSE, f"not a line of JSON: {_brief(line)} ({_reason(error)})")
    if not isinstance(document, dict):
        return Failure(FailureKind.NONSENSE, f"not a JSON object: {_brief(line)}")
    return parse_answer(document, frame_no, objects)


def parse_answer(document: dict[str, Any], frame_no: int, objects: int) -> ExternalAnswer | Failure:
    """The answer in a document."""
    if document.get("schema", SCHEMA) != SCHEMA:
        return Failure(FailureKind.NONSENSE, f"schema {document['schema']!r:.60} came, {SCHEMA} was expected")
    if document.get("frame_no") != frame_no or isinstance(document.get("frame_no"), bool):
        came = document.get("frame_no", "no frame_no")
        return Failure(FailureKind.NONSENSE, f"an answer to frame {came!r:.40} came, to {frame_no} was expected")
    try:
        known = {key: value for key, value in document.items() if key in _KEYS and value is not None}
        return _answer(known, objects)
    except (ValueError, TypeError, OverflowError) as error:
        return Failure(FailureKind.NONSENSE, plain_line(str(error))[:MOST_DETAIL], in_step=True)


def _answer(document: dict[str, Any], objects: int) -> ExternalAnswer:
    attitude = _attitude(document)
    status = _text(document, "status", _IDENTIFIED if attitude else "NO_MATCH")
    if status == _IDENTIFIED and attitude is None:
        raise ValueError(f"status is {_IDENTIFIED} without ra_deg and de_deg, or a quaternion")
    if status in NO_ANSWER:
        attitude = None
    rows, stars = _matches(document.get("matches", []), objects)
    elapsed_us = _number(document, "elapsed_us", 0, 1e12) if "elapsed_us" in document else None
    call_us = _number(document, "call_us", 0, 1e12) if "call_us" in document else None
    has_roll, detail = "roll_deg" in document or "quaternion" in document, _text(document, "detail", "")
    return ExternalAnswer(document, attitude, has_roll, status, detail, rows, stars, elapsed_us, call_us)


def _attitude(document: dict[str, Any]) -> Attitude | None:
    if "quaternion" in document:
        return Attitude(_rotation(document), np.zeros((3, 3)))
    if "ra_deg" not in document and "de_deg" not in document:
        return None
    roll_deg = _number(document, "roll_deg", -360, 360) if "roll_deg" in document else 0.0
    return Attitude.from_angles(_number(document, "ra_deg", 0, 360), _number(document, "de_deg", -90, 90), roll_deg)


def _rotation(document: dict[str, Any]) -> NDArray[np.float64]:
    numbers = document["quaternion"]
    if not (isinstance(numbers, list) and len(numbers) == 4 and all(_is_number(number) for number in numbers)):
        raise ValueError(f"quaternion is {numbers!r:.60}: expected a list of four numbers")
    order, maps = document.get("order"), document.get("maps")
    if order not in (_SCALAR_FIRST, _SCALAR_LAST) or maps not in (_TO_SENSOR, _TO_ICRS):
        raise ValueError(
            f"a quaternion needs order ({_SCALAR_FIRST} or {_SCALAR_LAST}) and maps ({_TO_SENSOR} or {_TO_ICRS})"
        )
    w, x, y, z = numbers if order == _SCALAR_FIRST else (numbers[3], *numbers[:3])
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(norm - 1) <= _NORM_WITHIN:
        raise ValueError(f"quaternion has the length {norm:g}: expected 1")
    w, x, y, z = w / norm, x / norm, y / norm, z / norm
    rotation = np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )
    return rotation if maps == _TO_SENSOR else rotation.T


def _matches(matches: Any, objects: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Objects and their stars, each object once."""
    if not isinstance(matches, list) or len(matches) > objects:
        raise ValueError(f"matches is {matches!r:.60}: expected a list of at most {objects}, one for each object")
    if not matches:
        return _NONE, _NONE
    rows, stars = [], []
    for match in matches:
        named: dict[str, Any] = match if isinstance(match, dict) else {}
        row, star = named.get("object"), _star(named.get("star"))
        if not (_is_whole(row) and 0 <= row < objects and row not in rows):
            raise ValueError(f"matches has {match!r:.60}: expected an object from 0 to {objects - 1}, each once")
        if star is None:
            raise ValueError(
                f"matches has {match!r:.60}: expected the number of a star in the catalogue, whole or as text"
            )
        rows.append(row)
        stars.append(star)
    return np.array(rows, dtype=np.int64), np.array(stars, dtype=np.int64)


def _star(value: Any) -> int | None:
    """The number of a star, from a whole number or from its digits: programs with doubles alone keep 53 bits of 64."""
    if isinstance(value, str) and _STAR.fullmatch(value):
        value = int(value)
    return value if _is_whole(value) and abs(value) < 2**63 else None


def _number(document: dict[str, Any], key: str, low: float, high: float) -> float:
    value: Any = document.get(key)
    if not (_is_number(value) and low <= value <= high):
        raise ValueError(f"{key} is {value!r:.40}: expected a number from {low:g} to {high:g}")
    return float(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, _NUMBERS) and not isinstance(value, bool) and abs(value) < 1e300


def _is_whole(value: Any) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool)


def _text(document: dict[str, Any], key: str, default: str) -> str:
    value = document.get(key)
    if value is None:
        return default
    if not isinstance(value, str):
        raise ValueError(f"{key} is {value!r:.40}: expected text")
    return plain_line(value)[:MOST_DETAIL]


def _no_number(name: str) -> float:
    raise ValueError(f"{name} is not a number")


_DECODER = json.JSONDecoder(parse_constant=_no_number)


def _reason(error: Exception) -> str:
    return plain_line(str(error))[:80] if isinstance(error, ValueError) else type(error).__name__


def _brief(line: bytes) -> str:
    text = plain_line(line[:60].decode("utf-8", "replace"))
    return repr(text) if len(line) <= 60 else f"{text!r}..."
