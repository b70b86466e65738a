"""A telnet connection taken apart: what a server may send, and one that does not keep to it."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.urlhandlers.network_ports import (
    DO,
    IAC,
    LONGEST_SUBOPTION,
    SB,
    SE,
    WILL,
    Data,
    Option,
    Suboption,
    TelnetCommand,
    TelnetParser,
)

PARTS = st.one_of(
    st.binary(max_size=20).map(Data),
    st.tuples(st.sampled_from([DO, WILL]), st.binary(min_size=1, max_size=1)).map(lambda pair: Option(*pair)),
    st.binary(max_size=20).map(Suboption),
    st.sampled_from([b"\xf1", b"\xf9"]).map(TelnetCommand),
)


def encoded(part: Data | Option | Suboption | TelnetCommand) -> bytes:
    if isinstance(part, Data):
        return part.data.replace(IAC, IAC + IAC)
    if isinstance(part, Suboption):
        return IAC + SB + part.data.replace(IAC, IAC + IAC) + IAC + SE
    return IAC + b"".join(part)


def joined(parts: list[Data | Option | Suboption | TelnetCommand]) -> list[Data | Option | Suboption | TelnetCommand]:
    """Data that follow each other in one piece."""
    found: list[Data | Option | Suboption | TelnetCommand] = []
    for part in parts:
        if isinstance(part, Data) and found and isinstance(found[-1], Data):
            found[-1] = Data(found[-1].data + part.data)
        elif part != Data(b""):
            found.append(part)
    return found


@given(st.lists(PARTS), st.lists(st.integers(0, 200)))
def test_every_part_comes_back_wherever_the_stream_is_cut(
    parts: list[Data | Option | Suboption | TelnetCommand], cuts: list[int]
) -> None:
    stream = b"".join(map(encoded, parts))
    parser, found = TelnetParser(), []
    places = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    for begin, end in pairwise(places):
        found += list(parser.feed(stream[begin:end]))
    assert joined(found) == joined(parts)


def test_a_suboption_without_an_end_is_refused_before_it_takes_memory() -> None:
    parser = TelnetParser()
    assert list(parser.feed(IAC + SB + LONGEST_SUBOPTION * b"A")) == []
    with pytest.raises(ValueError, match="suboption of more than"):
        list(parser.feed(b"A"))


def test_an_end_without_a_beginning_is_nothing() -> None:
    assert list(TelnetParser().feed(b"a" + IAC + SE + b"b")) == [Data(b"a"), Data(b"b")]
