"""Options that are gone, each with the sentence that names what does it now.

A line in a script that still has one ends with exit code 2 and that sentence.
"""

_PLAN = "'gse plan SESSION' plans from a recorded session; without one 'gse preflight' says how long a session must be"
_THREADS = "leave it out: a replay chooses itself, and its results are the same"

RETIRED = {
    ("gse ci", "--cut"): "leave it out; 'gse run --port replay://FILE?cut=37' receives a session in pieces of 37 bytes",
    ("gse replay", "--expect"): (
        "'gse ci FOLDER --identifier X' compares with NAME.answers.ndjson, 'gse compare FILE --with-sensor' with what "
        "the sensor sent"
    ),
    ("gse replay", "--loop"): "'gse run --port replay://FILE?loop=3' receives a session three times in a row",
    ("gse replay", "--step"): "'gse view FILE' goes from frame to frame, 'gse replay FILE --json-frames' prints each",
    ("gse replay", "--threads"): _THREADS,
    ("gse report", "--threads"): _THREADS,
    **{
        ("gse plan", option): _PLAN
        for option in (
            *("--station", "--noise", "--roll-noise", "--tau", "--error", "--limit", "--truth", "--rate"),
            "--availability",
        )
    },
}
"""By command and option."""


def retired(command: str, option: str) -> str | None:
    """What does now what an option did; None where there was no such option."""
    sentence = RETIRED.get((command, option))
    return None if sentence is None else f"'{' '.join(filter(None, (command, option)))}' is retired: {sentence}"
