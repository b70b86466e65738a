"""The sensor's recorded ATTITUDE frames as expected answers: whether flight software says what the sensor said.

Compared are the counts of the wire. An answer is brought to the sensor's convention, rounded as the protocol rounds it,
and must then be the number that the sensor sent. Angles in ICRS and quaternions between the same axes are taken as they
were answered, so that a wire of double precision is compared to the last bit; other conventions go through a rotation,
which costs the last of 52 bits. A quaternion and its negative are the same rotation.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from gse.external.answers import ExternalAnswer
from gse.station.frame_results import FrameResult, FrameResults
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.station.session_tables import ACQUIRED, ANGLES, QUATERNION
from gse.truth.frames import icrs_to_frame
from gse.values.attitude_convention import AttitudeConvention, state_angles, state_quaternions
from gse.values.matrices import product
from gse.values.text import count_text
from protocols import AttitudeMessage, Protocol

MOST_LISTED = 5
"""Most differences that are described; all are counted."""
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
