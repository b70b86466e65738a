"""Commands to the sensor: send, wait for the answer, repeat.

The formats of command and answer belong to the protocol. Times are those of the link: the host's for a live port, the
data's for a simulated one.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import TypeVar

from drivers.errors import CommandError
from drivers.link import SerialLink
from drivers.mock.timestamped_port import Item

ANSWER_S = 0.5
"""A command not answered within this time may be repeated, ICD of the panorama protocol."""
REPEATS = 3
_POLL_S = 0.05

Answer = TypeVar("Answer")


def send_command(
    link: SerialLink,
    make_frame: Callable[[int], bytes],
    deliver: Callable[[Item], None],
    answer_to: Callable[[Mapping[int, int]], Answer | None],
    *,
    first_sequence: int = 0,
    answer_s: float = ANSWER_S,
    repeats: int = REPEATS,
    instead: Callable[[], str] = lambda: "",
) -> Answer:
    """The sensor's answer to a command.

    ``make_frame`` gives the frame for a sequence number; each repetition takes the next one. ``deliver`` gets
    everything that is received meanwhile. ``answer_to`` returns the answer if it was among it, else None; its argument
    maps each sequence number sent so far to the monotonic time of sending, before which no answer can have come.
    CommandError without an answer, with what came ``instead`` where anything did.
    """
    sent_ns: dict[int, int] = {}
    for attempt in range(1 + repeats):
        sequence = first_sequence + attempt
        sent_ns[sequence] = link.send(make_frame(sequence)).mono_ns
        answer = receive_until(link, partial(answer_to, sent_ns), deliver, answer_s)
        if answer is not None:
            return answer
    asked = (
        f"asked {1 + repeats} times and waited {answer_s:g} s each time" if repeats else f"asked once, {answer_s:g} s"
    )
    came = instead() or "check its power, its transmit line, the baud rate and the protocol"
    raise CommandError(f"the sensor on {link.url} did not answer, {asked}; {came}")


def receive_until(
    link: SerialLink, found: Callable[[], Answer | None], deliver: Callable[[Item], None], timeout_s: float
) -> Answer | None:
    """Receive until ``found`` returns an answer, at most ``timeout_s`` of the link's time; None without one.

    One item at a time: a simulated sensor at full speed that gave all it has would be at its end before it is asked.
    """
    until_ns = link.mono_ns() + round(timeout_s * 1e9)
    answer = found()
    while answer is None and link.mono_ns() < until_ns and not link.at_end:
        for item in link.receive(_POLL_S, most=1):
            deliver(item)
        answer = found()
    return answer
