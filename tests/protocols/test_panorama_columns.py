"""Many panoramas decoded as columns are those decoded one by one."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols import Frame, Protocol, built_in_names, load_protocol

PROTOCOLS = [protocol for protocol in map(load_protocol, built_in_names()) if protocol.slots]


def frames_of(protocol: Protocol, fills: Sequence[tuple[int, bytes]]) -> list[Frame]:
    """Frames whose payload begins with some bytes, a PANORAMA's length long."""
    code = next(code for code, name in protocol.frame_layout.names.items() if name == "PANORAMA")
    size = protocol.frame_layout.sizes[code]
    return [
        Frame(0, size, "PANORAMA", 0, 0, (b"\0" * min(at, size) + data).ljust(size, b"\0")[:size], size)
        for at, data in fills
    ]


@pytest.mark.parametrize("protocol", PROTOCOLS, ids=lambda protocol: protocol.name)
@given(fills=st.lists(st.tuples(st.integers(0, 60), st.binary(max_size=300)), min_size=1, max_size=6))
def test_whatever_the_payloads_hold_no_panorama_depends_on_those_beside_it(
    protocol: Protocol, fills: list[tuple[int, bytes]]
) -> None:
    frames = frames_of(protocol, fills)
    columns = protocol.decode_panoramas(frames)
    assert len(columns) == len(frames)
    for k, frame in enumerate(frames):
        assert columns[k] == protocol.decode(frame)
        assert len(columns[k].xy_px) <= protocol.slots
