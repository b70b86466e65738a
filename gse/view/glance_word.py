"""The one big word on a session: what to know from the other side of the roof."""

import re
from dataclasses import dataclass
from enum import StrEnum

NO_ANSWER_S = 2.0
"""Time without an answer after which the word says so."""
LATE_S = 2.0
"""Time that bytes wait in this computer from which on a display says that it is behind."""
ACQUIRING_S = 10.0
"""Time from the first panorama in which no answer is not an alarm yet."""


class Level(StrEnum):
    """How much a word asks for attention."""

    IDLE = "idle"
    GOOD = "good"
    WARN = "warn"
    BAD = "bad"


class Phase(StrEnum):
    """Where a session stands."""

    RUNNING = "running"
    JUDGING = "judging"
    ENDED = "ended"


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """What the word follows from. ``link`` is of LINK_WORDS; ``sky`` is CLOUD, NO STARS, DAYLIGHT or empty.

    ``verdict`` is as a report prints it, such as "PASS, relative (SIMULATED)". ``objects`` is None of a sensor that
    sends no panoramas.
    ``since_answer_s`` counts from the first panorama as long as there was no answer; ``outside`` names the limits that
    are not kept; ``aligning_s`` is the time left for the fit of the mount; ``cause`` is what the station found out.
    ``behind_s`` is how long this computer has had bytes that it is not done with. ``stands_still_for`` is what a
    simulation asks its operator, whose time stands still meanwhile: step 2: Take the cap off.
    """

    phase: Phase = Phase.RUNNING
    verdict: str = ""
    reasons: tuple[str, ...] = ()
    link: str = "no link"
    port: str = ""
    since_frame_s: float = 0.0
    frames: int = 0
    objects: int | None = 0
    answered: bool = False
    since_answer_s: float = 0.0
    sky: str = ""
    aligning_s: float = 0.0
    outside: tuple[str, ...] = ()
    cause: str = ""
    behind_s: float = 0.0
    stands_still_for: str = ""


@dataclass(frozen=True, slots=True)
class Word:
    """The word, how much it asks for attention, and a line that explains it."""

    text: str
    level: Level
    detail: str = ""


def word_of(facts: Facts) -> Word:
    """The word for a session: what is most wrong comes first."""
    if facts.phase is not Phase.RUNNING:
        return _at_the_end(facts)
    if facts.stands_still_for:
        step = facts.stands_still_for.partition(":")[0]
        return Word("WAITING FOR YOU", Level.WARN, f"the simulation stands still until the operator answers {step}")
    return _of_this_computer(facts) or _of_link(facts) or _of_answers(facts) or _of_errors(facts)


def _at_the_end(facts: Facts) -> Word:
    if facts.phase is Phase.JUDGING:
        return Word("JUDGING", Level.IDLE, "the session is closed; its verdict follows")
    if not facts.verdict:
        return Word("ENDED", Level.WARN, "the session ended without a verdict")
    why = "; ".join(facts.reasons)
    verdict = bare_verdict(facts.verdict)
    qualified = f"{facts.verdict}: " if facts.verdict != verdict else ""
    return Word(f"DONE: {verdict}", level_of(facts.verdict), qualified + why)


def level_of(verdict: str) -> Level:
    """How much a verdict asks for attention."""
    return {"PASS": Level.GOOD, "FAIL": Level.BAD}.get(bare_verdict(verdict), Level.WARN)


def bare_verdict(verdict: str) -> str:
    """PASS, FAIL or INCONCLUSIVE of a verdict as it is printed."""
    return re.split("[, ]", verdict, maxsplit=1)[0]


def _of_this_computer(facts: Facts) -> Word | None:
    """That it is behind, unless the frames that it is done with want an answer."""
    if facts.behind_s < LATE_S or facts.since_answer_s >= (NO_ANSWER_S if facts.answered else ACQUIRING_S):
        return None
    lasts = _duration(facts.behind_s)
    return Word(f"BEHIND {lasts}", Level.WARN, f"this computer works on bytes of {lasts} ago; all bytes are recorded")


def _of_link(facts: Facts) -> Word | None:
    if facts.link in ("no port", "silent") and facts.frames:
        gone = facts.link == "no port"
        what = f"{facts.port} is {'gone' if gone else 'silent'}, no bytes for {facts.since_frame_s:.0f} s"
        following = "check the cable, it is opened again by itself" if gone else "check the sensor and its power"
        return Word("LINK LOST", Level.BAD, f"{what}: {following}")
    if not facts.frames:
        if facts.cause:
            return Word("WAITING", Level.WARN, facts.cause)
        waits = "for the port" if facts.link == "no port" else "for the first panorama"
        unread = ", bytes come but no frame is found in them" if facts.link == "syncing" else ""
        return Word("WAITING", Level.IDLE, f"{waits} on {facts.port}{unread}")
    return None


def _of_answers(facts: Facts) -> Word | None:
    if facts.since_answer_s < (NO_ANSWER_S if facts.answered else ACQUIRING_S):
        return None if facts.answered else Word("ACQUIRING", Level.IDLE, f"no answer yet, {_objects(facts)}")
    lasts, objects = _duration(facts.since_answer_s), _objects(facts)
    if facts.sky:
        return Word(facts.sky, Level.WARN, f"{lasts} without an answer, {objects}; frames without sky do not count")
    cause = f"; {facts.cause}" if facts.cause and not facts.answered else ""
    return Word(f"NO ANSWER {lasts}", Level.BAD, objects + cause)


def _objects(facts: Facts) -> str:
    """What the last panorama had, or that none comes: then the sensor or this computer is slow, not the sky."""
    if facts.since_frame_s >= NO_ANSWER_S:
        frame = "ATTITUDE frame" if facts.objects is None else "panorama"
        return f"no {frame} for {_duration(facts.since_frame_s)}"
    if facts.objects is None:
        return "its ATTITUDE frames hold none"
    return f"{facts.objects} object{'' if facts.objects == 1 else 's'}"


def _of_errors(facts: Facts) -> Word:
    if facts.aligning_s > 0:
        return Word("ACQUIRING", Level.IDLE, f"the mount is fitted, {facts.aligning_s:.0f} s left")
    if facts.outside:
        cause = f"; {facts.cause}" if facts.cause else ""
        return Word("OUTSIDE", Level.BAD, f"{', '.join(facts.outside)}{cause}")
    return Word("OK", Level.GOOD, "inside the limits so far")


def _duration(seconds: float) -> str:
    minutes = int(seconds) // 60
    if minutes < 2:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h"
