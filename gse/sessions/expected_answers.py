"""The answers that are expected of an identifier, in a file or in the session itself.

NAME.answers.ndjson (gse.answer/1) has a line of JSON for each panorama: ``gse ci --identifier X --update`` writes it,
or a flight computer. Its first line may say whose answers they are and to which session (gse.identifier/1 with
``session_sha256``). Lines and panoramas are paired by their frame numbers, the k-th line of a number with its k-th
panorama, so that the order of the lines does not matter. A time-out on either side is counted for itself: it tells of a
busy host, not of the answer.

The sensor's recorded ATTITUDE frames tell whether flight software says what the sensor said. Compared are the counts of
the wire. An answer is brought to the sensor's convention, rounded as the protocol rounds it, and must then be the
number that the sensor sent. Angles in ICRS and quaternions between the same axes are taken as they were answered, so
that a wire of double precision is compared to the last bit; other conventions go through a rotation, which costs the
last of 52 bits. A quaternion and its negative are the same rotation.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from drivers.host_files import only_a_file, write_whole
from drivers.outside_text import plain_line
from gse.errors import TableError, UsageError
from gse.external.answers import NO_ANSWER, ExternalAnswer, Failure, FailureKind
from gse.station.frame_results import FrameResult, FrameResults
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.station.session_tables import ACQUIRED, ANGLES, QUATERNION
from gse.truth.frames import icrs_to_frame
from gse.values.attitude_convention import (
    AttitudeConvention,
    from_angles,
    from_quaternions,
    state_angles,
    state_quaternions,
)
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.matrices import product
from gse.values.text import count_text
from protocols import AttitudeMessage, Protocol

SUFFIX = ".answers.ndjson"
MOST_BYTES = 200_000_000
"""Largest file that is read; eight hours of answers at 10 Hz take 35 MB."""
LONGEST_LINE = 100_000
"""Longest line that is read, in characters; an answer with the matches of 30 objects takes 4,000."""
MOST_LISTED = 5
"""Most differences that are described; all are counted."""

_IDENTITY = "gse.identifier/1"
_ANGLES = ("ra_deg", "de_deg", "roll_deg")
_QUATERNION = ("quaternion", "order", "maps")
_FORMS = (
    *("none", "angles", "scalar-first icrs-to-sensor", "scalar-first sensor-to-icrs"),
    *("scalar-last icrs-to-sensor", "scalar-last sensor-to-icrs"),
)
_NONE, _OF_ANGLES = 0, 1
_ROW = np.dtype(
    [("frame_no", "i8"), *((key, "f8") for key in _ANGLES), ("quaternion", "f8", 4), ("form", "i1"), ("word", "S24")]
)
"""An answer to the last bit, in a tenth of the memory of its JSON; NaN where it has no such number.

``form`` is a place in _FORMS. ``word`` is the status without which there would be no reason for no answer, or the kind
of a failure; empty where the line states none.
"""
_TIMEOUT = f"failure {FailureKind.TIMEOUT}".encode()


class GivenAnswers:
    """A listener that keeps the answers that a replay gives, as lines of gse.answer/1."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """Keep the answers of the identifier under test; a session of own answers alone has none of it."""
        if session.subject is not Subject.SENSOR:
            self.lines += [json.dumps(answer_document(result)) + "\n" for result in results]

    def on_event(self, event: LinkEvent) -> None:
        """Nothing: events are no answers."""

    def rows(self) -> NDArray[np.void]:
        """The answers as rows of _ROW."""
        return np.fromiter((_row(json.loads(line)) for line in self.lines), _ROW, len(self.lines))


def answer_document(result: FrameResult) -> dict[str, Any]:
    """The answer to a panorama: as an external identifier wrote it, else the angles of the attitude, or why there is
    none. Times are left out: they differ in each run."""
    frame_no, answer = {"frame_no": result.panorama.frame_no}, result.given.answer if result.given else None
    if isinstance(answer, Failure):
        return frame_no | {"failure": answer.kind.value}
    if answer is not None:
        return frame_no | _compared(answer.document)
    if result.attitude is None:
        return frame_no | {"status": result.status.value}
    return frame_no | {key: getattr(result.attitude, key) for key in _ANGLES}


def write_answers(path: Path, lines: list[str], session: SessionData) -> None:
    """Write the answers to a session, with a first line that says whose they are; UsageError where that cannot be."""
    head = json.dumps({**_identity(session), "session_sha256": session.raw_sha256}) + "\n"
    try:
        write_whole(path, [head, *lines])
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from error


def _identity(session: SessionData) -> dict[str, Any]:
    """Who answered: name, version and hashes of a program, or the name of a built-in identifier."""
    return session.external or {"schema": _IDENTITY, "plug": "built-in", "name": session.station.identifier.label}


@dataclass(frozen=True, slots=True)
class ExpectedAnswers:
    """The answers of a file as rows of _ROW, and what its first line says of them; empty where it says nothing."""

    path: Path
    identity: dict[str, Any]
    rows: NDArray[np.void]

    def check_session(self, session: SessionData) -> None:
        """TableError where these are answers to another session."""
        stated = self.identity.get("session_sha256", session.raw_sha256)
        if stated != session.raw_sha256:
            raise TableError(
                f"{self.path} has the answers to another session (SHA-256 {stated!s:.12}..., this one has "
                f"{session.raw_sha256:.12}...); 'gse ci --identifier X --update' writes those to this one"
            )

    def other_program(self, session: SessionData) -> str:
        """In a line, that the expected answers are those of another identifier or version; empty where they are not."""
        then, now = _name(self.identity), _name(_identity(session))
        return f"the expected answers are of {then}, these are of {now}" if self.identity and then != now else ""


def _name(identity: dict[str, Any]) -> str:
    return plain_line(", ".join(str(identity[key]) for key in ("name", "version") if key in identity))[:200]


def read_answers(path: Path) -> ExpectedAnswers:
    """The expected answers of a file; TableError where it is missing, damaged, too large, or without an answer."""
    identity: dict[str, Any] = {}
    documents = _documents(path, identity)
    rows = np.fromiter((_row(document) for document in documents), _ROW)
    if not len(rows) and not identity:
        raise TableError(f"{path} has no answer: expected a line of JSON for each frame")
    return ExpectedAnswers(path, identity, rows)


def _documents(path: Path, identity: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The answers of a file; the line that says whose they are goes into ``identity``."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise TableError(f"{path} is larger than {MOST_BYTES} bytes; expected answers as lines of JSON")
        with open(path, encoding="utf-8", opener=only_a_file) as file:
            for number, line in enumerate(iter(lambda: file.readline(LONGEST_LINE + 1), ""), 1):
                if len(line) > LONGEST_LINE:
                    raise TableError(f"{path}, line {number} is longer than {LONGEST_LINE} characters")
                if number == 1 and f'"{_IDENTITY}"' in line:
                    identity |= _object(path, number, line)
                elif line.strip():
                    yield _checked(path, number, line)
    except FileNotFoundError:
        raise TableError(f"there are no expected answers {path.name}; 'gse ci --update' writes them") from None
    except OSError as error:
        raise TableError(f"cannot read {path}: {error.strerror}; expected answers as lines of JSON") from error
    except UnicodeDecodeError as error:
        raise TableError(f"{path} is not UTF-8 text: expected answers as lines of JSON") from error


def _object(path: Path, number: int, line: str) -> dict[str, Any]:
    try:
        document = json.loads(line)
    except (ValueError, RecursionError):
        document = None
    if not isinstance(document, dict):
        raise TableError(f"{path}, line {number}: expected an answer as JSON with frame_no, ra_deg and de_deg")
    return document


def _checked(path: Path, number: int, line: str) -> dict[str, Any]:
    """The answer of a line with its compared keys; TableError where a number is none."""
    document = _object(path, number, line)
    where, frame_no = f"{path}, line {number}", document.get("frame_no")
    if not isinstance(frame_no, int) or isinstance(frame_no, bool) or not 0 <= frame_no < 2**63:
        raise TableError(f"{where}: frame_no is {frame_no!r:.40}; expected the number of a panorama")
    answer = {"frame_no": frame_no, **_compared(document)}
    quaternion, alone = answer.get("quaternion"), {"ra_deg", "de_deg"} & answer.keys()
    if quaternion is not None:
        if not isinstance(quaternion, list) or len(quaternion) != 4 or not all(map(_is_finite, quaternion)):
            raise TableError(f"{where}: quaternion is {quaternion!r:.60}; expected four numbers")
        if f"{answer.get('order')} {answer.get('maps')}" not in _FORMS:
            raise TableError(f"{where}: a quaternion needs its order and maps, as an answer states them")
    elif len(alone) == 1:
        raise TableError(f"{where}: {alone.pop()} stands alone; expected ra_deg and de_deg, or no answer")
    for key in _ANGLES:
        if not _is_finite(answer.get(key, 0.0)):
            raise TableError(f"{where}: {key} is {answer[key]!r:.60}; expected a number, or no answer")
    return answer


def _compared(document: dict[str, Any]) -> dict[str, Any]:
    """The keys of an answer that are compared; numbers beside a status of no answer were left in their place."""
    numbers = () if document.get("status") in NO_ANSWER else (*_ANGLES, *_QUATERNION)
    return {key: document[key] for key in ("status", "failure", *numbers) if document.get(key) is not None}


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def _row(answer: dict[str, Any]) -> tuple[Any, ...]:
    """An answer as a row of _ROW."""
    word = f"failure {answer['failure']}" if "failure" in answer else str(answer.get("status", ""))
    angles, quaternion, form = (np.nan, np.nan, np.nan), (np.nan,) * 4, _NONE
    if "quaternion" in answer:
        quaternion, form = tuple(answer["quaternion"]), _FORMS.index(f"{answer['order']} {answer['maps']}")
    elif "ra_deg" in answer:
        angles, form = tuple(answer.get(key, np.nan) for key in _ANGLES), _OF_ANGLES
    if form != _NONE and word == "IDENTIFIED":  # which an answer with RA and DE need not say
        word = ""
    return (answer["frame_no"], *angles, quaternion, form, plain_line(word).encode("ascii", "replace"))


@dataclass(frozen=True, slots=True)
class AnswerComparison:
    """What a replay answered beside what was expected.

    ``compared`` frames have both; of these ``different`` were answered otherwise, and ``unanswered`` are no answer on
    both sides. ``timeouts_then`` and ``timeouts_now`` are frames beside them with a time-out on one side or both.
    ``missing`` frames have no expected answer, ``unused`` expected answers no frame. ``farthest_arcsec`` is the largest
    rotation between two answers. ``listed`` describes the first differences.
    """

    compared: int
    different: int
    unanswered: int
    timeouts_then: int
    timeouts_now: int
    missing: int
    unused: int
    farthest_arcsec: float
    listed: tuple[str, ...]

    @property
    def is_same(self) -> bool:
        """Whether each frame was answered as expected, and each expected answer was given."""
        return not (self.different or self.missing or self.unused)

    @property
    def text(self) -> str:
        """The result in a line."""
        farthest = f", by up to {self.farthest_arcsec:.3g} arcsec" if self.farthest_arcsec else ""
        timeouts = self.timeouts_then + self.timeouts_now
        parts = (
            f"{self.different:,} of {self.compared:,} answers differ{farthest}",
            f"{self.unanswered:,} of them are no answer on both sides" if self.unanswered else "",
            f"{count_text(timeouts, 'time-out')} ({self.timeouts_then} expected, {self.timeouts_now} now) not compared"
            if timeouts
            else "",
            f"{count_text(self.missing, 'frame')} without an expected answer" if self.missing else "",
            f"{count_text(self.unused, 'expected answer')} without a frame" if self.unused else "",
        )
        return "; ".join(part for part in parts if part)

    @property
    def text_kept(self) -> str:
        """The answers in a line, where they become the expected ones."""
        late = f"; {count_text(self.timeouts_then, 'time-out')}: repeat this on a quiet host" * bool(self.timeouts_then)
        return f"{self.compared:,} answers, {self.unanswered:,} of them no answer{late}"


def compare_answers(
    expected: NDArray[np.void], given: NDArray[np.void], *, within_arcsec: float | None = None
) -> AnswerComparison:
    """Compare answers to the last bit, or by the rotation between them; both are rows of _ROW.

    Within a tolerance the rotation about the boresight counts as well as the one across it, so that an answer at the
    pole, where RA and roll turn alike, and an angle of 360 deg need no case of their own. Answers without a roll are
    compared by their boresights.
    """
    of_expected, of_given = _pairs(expected["frame_no"], given["frame_no"])
    then, now = expected[of_expected], given[of_given]
    late_then, late_now = (side["word"] == _TIMEOUT for side in (then, now))
    kept = ~(late_then | late_now)
    then, now = then[kept], now[kept]
    apart_arcsec = _apart_arcsec(then, now)
    wrong = _wrong(then, now) if within_arcsec is None else ~(apart_arcsec <= within_arcsec)
    answered = [side["form"] != _NONE for side in (then, now)]
    stated = (then["word"] != b"") & (now["word"] != b"")
    wrong = np.where(answered[0] & answered[1], wrong, answered[0] != answered[1]) | (
        stated & (then["word"] != now["word"])
    )
    differing = np.flatnonzero(wrong)
    return AnswerComparison(
        compared=len(then),
        different=len(differing),
        unanswered=int((~answered[0] & ~answered[1]).sum()),
        timeouts_then=int(late_then.sum()),
        timeouts_now=int((late_now & ~late_then).sum()),
        missing=len(given) - len(of_given),
        unused=len(expected) - len(of_expected),
        farthest_arcsec=float(np.nanmax(apart_arcsec[differing], initial=0.0)),
        listed=tuple(_difference(then[k], now[k], float(apart_arcsec[k])) for k in differing[:MOST_LISTED]),
    )


def _pairs(then: NDArray[np.int64], now: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows of equal frame numbers, the k-th of a number on one side with the k-th on the other; in the order of now."""
    numbered = np.concatenate([np.column_stack([numbers, _occurrence(numbers)]) for numbers in (then, now)])
    _, label = np.unique(numbered, axis=0, return_inverse=True)
    row_then = np.full(label.max(initial=-1) + 1, -1)
    row_then[label[: len(then)]] = np.arange(len(then))
    of_now = row_then[label[len(then) :]]
    rows_now = np.flatnonzero(of_now >= 0)
    return of_now[rows_now], rows_now


def _occurrence(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """How often each number came before: 0 for the first time."""
    order = np.argsort(numbers, kind="stable")
    _, first, counts = np.unique(numbers[order], return_index=True, return_counts=True)
    count = np.empty(len(numbers), np.int64)
    count[order] = np.arange(len(numbers)) - np.repeat(first, counts)
    return count


def _wrong(then: NDArray[np.void], now: NDArray[np.void]) -> NDArray[np.bool_]:
    """Where answers are not equal to the last bit; a number that is on neither side is equal."""
    one, other = (np.column_stack([*(side[key] for key in _ANGLES), side["quaternion"]]) for side in (then, now))
    equal = (one == other) | (np.isnan(one) & np.isnan(other))
    return np.asarray(~equal.all(axis=1) | (then["form"] != now["form"]))


def _apart_arcsec(then: NDArray[np.void], now: NDArray[np.void]) -> NDArray[np.float64]:
    """The rotation from one answer to the other; that of the boresights where neither has a roll, else NaN."""
    rotations = [_rotations(side) for side in (then, now)]
    has_roll = [(side["form"] > _OF_ANGLES) | np.isfinite(side["roll_deg"]) for side in (then, now)]
    chord = np.linalg.norm(rotations[0] - rotations[1], axis=(1, 2)) / np.sqrt(2)
    boresights = np.linalg.norm(rotations[0][:, 2] - rotations[1][:, 2], axis=1)
    chord = np.where(has_roll[0], chord, boresights)
    chord[has_roll[0] != has_roll[1]] = np.nan
    return np.asarray(2 * np.arcsin(np.minimum(chord / 2, 1)) * ARCSEC_PER_RAD)


def _rotations(side: NDArray[np.void]) -> NDArray[np.float64]:
    """Rotations (N, 3, 3) from ICRS to the sensor, NaN without an answer."""
    rotations = from_angles(side["ra_deg"], side["de_deg"], np.nan_to_num(side["roll_deg"]))
    for form, name in enumerate(_FORMS[2:], 2):
        rows = side["form"] == form
        # an answer's quaternion turns vectors, that of a convention turns axes: the one is the other's conjugate
        scalar, conjugate = name.split()[0].removeprefix("scalar-"), name.endswith("icrs-to-sensor")
        rotations[rows] = from_quaternions(side["quaternion"][rows], scalar=scalar, conjugate=conjugate)
    return rotations


def _difference(then: np.void, now: np.void, apart_arcsec: float) -> str:
    """What a person must know of a different answer."""
    far = "" if np.isnan(apart_arcsec) else f"{apart_arcsec:.3g} arcsec away, "
    return f"frame {now['frame_no']}: {far}{_words(now)}; expected {_words(then)}"


def _words(row: np.void) -> str:
    word = row["word"].decode()
    if row["form"] == _NONE:
        return f"no answer ({word})" if word else "no answer"
    if row["form"] > _OF_ANGLES:
        return f"{_FORMS[row['form']]} {row['quaternion'].tolist()}"
    angles = ", ".join(f"{key} {float(row[key])!r}" for key in _ANGLES if np.isfinite(row[key]))
    return f"{angles} ({word})" if word else angles


MOST_WAITING = 1000
"""Results without an ATTITUDE frame yet, and ATTITUDE frames without a result: more than a minute at 10 Hz."""


@dataclass(frozen=True, slots=True)
class _Given:
    """What was answered for a panorama: the rotation, and the numbers of an external answer; None for no answer."""

    frame_no: int
    utc_ns: int
    icrs_to_sensor: NDArray[np.float64] | None
    document: dict[str, Any]


class ExpectedAttitudes:
    """A listener that compares answers with the ATTITUDE frames of the session itself, in the sensor's convention.

    ``compared`` panoramas have one, ``different`` of them were answered otherwise, ``missing`` panoramas have none; in
    ``answered`` of those compared there is an attitude on either side. ``listed`` describes the first differences.
    """

    def __init__(self, protocol: Protocol, convention: AttitudeConvention) -> None:
        self.compared = self.answered = self.different = self.missing = 0
        self.listed: list[str] = []
        self._protocol, self._convention = protocol, convention
        self._taken = self._dropped = 0
        self._results: dict[int, _Given] = {}
        self._sent: dict[int, np.void] = {}

    @property
    def unused(self) -> int:
        """ATTITUDE frames without a panorama in the replay."""
        return self._dropped + len(self._sent)

    @property
    def is_same(self) -> bool:
        """Whether each panorama was answered as the sensor did, and each ATTITUDE frame has its panorama."""
        return not (self.different or self.missing or self.unused)

    def text(self) -> str:
        """The result in one line, and the first differences."""
        without = self.compared - self.answered
        head = f"{self.different:,} of {self.compared:,} answers differ from the sensor's"
        head += f"; {without:,} of them are no answer on both sides" if without else ""
        head += f"; {count_text(self.missing, 'panorama')} without an ATTITUDE frame" if self.missing else ""
        head += f"; {count_text(self.unused, 'ATTITUDE frame')} without a panorama" if self.unused else ""
        return "\n".join([head, *(f"  {line}" for line in self.listed)])

    def on_event(self, event: LinkEvent) -> None:
        """Nothing: events are not compared."""

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """Compare results."""
        for result in results:
            self.compare(result, session)

    def compare(self, result: FrameResult, session: SessionData) -> None:
        """Compare as soon as a panorama and its ATTITUDE frame are there."""
        if session.subject is Subject.SENSOR:
            return
        panorama, answer = result.panorama, result.given.answer if result.given else None
        document = answer.document if isinstance(answer, ExternalAnswer) else {}
        rotation = None if result.attitude is None else result.attitude.icrs_to_sensor
        self._results[panorama.time_us] = _Given(panorama.frame_no, panorama.utc_ns, rotation, document)
        self._take(session)
        while len(self._results) > MOST_WAITING:
            self._results.pop(next(iter(self._results)))
            self.missing += 1

    def finish(self, session: SessionData) -> None:
        """Compare the answers that came after the last panorama; the panoramas that still wait have none."""
        self._take(session)
        self.missing += len(self._results)
        self._results.clear()

    def _take(self, session: SessionData) -> None:
        new = session.sensor_attitudes.columns[self._taken :]
        self._taken += len(new)
        self._sent |= {int(row["time_us"]): row.copy() for row in new}
        for time_us in [time_us for time_us in self._sent if time_us in self._results]:
            given, sent = self._results.pop(time_us), self._sent.pop(time_us)
            answered = given.icrs_to_sensor is not None or bool(sent["acquired"])
            self._count(given.frame_no, self._differences(given, sent), answered=answered)
        while len(self._sent) > MOST_WAITING:
            self._sent.pop(next(iter(self._sent)))
            self._dropped += 1

    def _count(self, frame_no: int, differences: Sequence[str], *, answered: bool) -> None:
        self.compared += 1
        self.answered += answered
        if differences:
            self.different += 1
            if len(self.listed) < MOST_LISTED:
                self.listed.append(f"frame {frame_no}: {'; '.join(differences)}")

    def _differences(self, given: _Given, sent: np.void) -> list[str]:
        if sent["frame_no"] not in (0, given.frame_no):
            return [f"the sensor answered frame {sent['frame_no']}"]
        if given.icrs_to_sensor is None or not sent["acquired"]:
            answers = given.icrs_to_sensor is not None
            return [] if answers == sent["acquired"] else [_only_one(answers)]
        if np.isfinite(sent["ra_deg"]):
            return self._different_angles(given, sent)
        return self._different_quaternion(given, sent)

    def _different_angles(self, given: _Given, sent: np.void) -> list[str]:
        answered = dict(zip(ANGLES, self._angles(given), strict=True))
        here = self._as_sent(sent, answered)
        keys = [key for key in ANGLES if np.isfinite(sent[key]) and np.isfinite(answered[key])]
        return [
            f"{key} is {getattr(here, key)!r}, the sensor sent {float(sent[key])!r}"
            for key in keys
            if not self._is_same(key, getattr(here, key), float(sent[key]))
        ]

    def _is_same(self, key: str, answered: float, sent: float) -> bool:
        """Whether two angles are equal, a full turn being none: 360 deg is the rounded answer just below it."""
        turn = 24.0 if (key, self._convention.ra_unit) == ("ra_deg", "h") else 360.0
        return answered == sent or (key != "de_deg" and abs(answered - sent) == turn)

    def _angles(self, given: _Given) -> list[float]:
        """RA, DE and roll as the sensor states them; NaN for a roll that was not answered."""
        document, convention = given.document, self._convention
        if "ra_deg" in document and _is_plain(convention):
            roll_deg = document.get("roll_deg", np.nan)
            return [float(document["ra_deg"]), float(document["de_deg"]), roll_deg % 360]
        angles = state_angles(self._stated(given), convention)[0].tolist()
        return [*angles[:2], np.nan] if document and not {"roll_deg", "quaternion"} & set(document) else angles

    def _different_quaternion(self, given: _Given, sent: np.void) -> list[str]:
        recorded = [float(sent[name]) for name in QUATERNION]
        numbers = self._quaternion(given)
        for sign in (1, -1):
            here = self._as_sent(sent, {name: sign * q for name, q in zip(QUATERNION, numbers, strict=True)})
            if [getattr(here, name) for name in QUATERNION] == recorded:
                return []
        shown = [getattr(here, name) for name in QUATERNION]
        return [f"the quaternion is {shown}, the sensor sent {recorded}"]

    def _quaternion(self, given: _Given) -> list[float]:
        """The quaternion as the sensor states it."""
        document, convention = given.document, self._convention
        if "quaternion" not in document or not _is_plain(convention):
            return list(state_quaternions(self._stated(given), convention)[0].tolist())
        q = document["quaternion"]
        w, vector = (q[0], q[1:]) if document["order"] == "scalar-first" else (q[3], q[:3])
        # as rotations of vectors one way is the other's conjugate; that of the sensor turns axes
        if (document["maps"] == "icrs-to-sensor") != convention.conjugate:
            vector = [-number for number in vector]
        return [w, *vector] if convention.scalar == "first" else [*vector, w]

    def _stated(self, given: _Given) -> NDArray[np.float64]:
        frame = icrs_to_frame(self._convention.frame, np.array([given.utc_ns]))
        return np.asarray(product(given.icrs_to_sensor[None], frame.transpose(0, 2, 1)))  # type: ignore[index]

    def _as_sent(self, sent: np.void, numbers: dict[str, float]) -> AttitudeMessage:
        values: dict[str, Any] = {name: float(np.nan_to_num(number)) for name, number in numbers.items()}
        message = AttitudeMessage(int(sent["time_us"]), state=ACQUIRED, latency_s=0.0, **values)
        read = self._protocol.as_sent(message)
        assert isinstance(read, AttitudeMessage)
        return read


def _is_plain(convention: AttitudeConvention) -> bool:
    """Whether the sensor's axes are those of an answer: its numbers need no rotation then."""
    # an identifier answers as the sensor sees: whatever is said of aberration, the numbers are compared
    same = AttitudeConvention(
        scalar=convention.scalar, conjugate=convention.conjugate, aberration=convention.aberration
    )
    return convention == same


def _only_one(answers: bool) -> str:
    return "an answer here, none by the sensor" if answers else "no answer here, one by the sensor"
