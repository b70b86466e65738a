"""Checksums against the published check values (CRC RevEng catalogue; CRC-32 also in the protocol's document)."""

import pytest
from crccheck.checksum import Checksum8, ChecksumXor8
from hypothesis import given
from hypothesis import strategies as st

from protocols.checksum import CHECKSUMS

CHECK_VALUES = {
    "crc32": 0xCBF43926,
    "crc16-ccitt-false": 0x29B1,
    "crc16-xmodem": 0x31C3,
    "crc16-genibus": 0xD64E,
    "crc16-mcrf4xx": 0x6F91,
    "crc16-x25": 0x906E,
    "crc16-kermit": 0x2189,
    "crc16-modbus": 0x4B37,
    "crc16-arc": 0xBB3D,
    "crc8": 0xF4,
    "crc8-maxim": 0xA1,
    "crc8-sae-j1850": 0x4B,
    "crc24-openpgp": 0x21CF02,
    "crc24-ble": 0xC25A56,
    "crc32-iscsi": 0xE3069283,
    "crc32-mpeg-2": 0x0376E6E7,
}

# name: polynomial, initial value, reflected, xor-out; as the catalogue gives them
PARAMETERS = {
    "crc32": (0x04C11DB7, 0xFFFFFFFF, True, 0xFFFFFFFF),
    "crc16-ccitt-false": (0x1021, 0xFFFF, False, 0),
    "crc16-xmodem": (0x1021, 0, False, 0),
    "crc16-genibus": (0x1021, 0xFFFF, False, 0xFFFF),
    "crc16-mcrf4xx": (0x1021, 0xFFFF, True, 0),
    "crc16-x25": (0x1021, 0xFFFF, True, 0xFFFF),
    "crc16-kermit": (0x1021, 0, True, 0),
    "crc16-modbus": (0x8005, 0xFFFF, True, 0),
    "crc16-arc": (0x8005, 0, True, 0),
    "crc8": (0x07, 0, False, 0),
    "crc8-maxim": (0x31, 0, True, 0),
    "crc8-sae-j1850": (0x1D, 0xFF, False, 0xFF),
    "crc24-openpgp": (0x864CFB, 0xB704CE, False, 0),
    "crc24-ble": (0x00065B, 0x555555, True, 0),
    "crc32-iscsi": (0x1EDC6F41, 0xFFFFFFFF, True, 0xFFFFFFFF),
    "crc32-mpeg-2": (0x04C11DB7, 0xFFFFFFFF, False, 0),
}
OTHERS = {"xxhash32", "none", "sum8", "xor8", "fletcher16"}
"""No CRCs."""


def test_every_crc_has_a_published_check_value() -> None:
    assert set(CHECKSUMS) - OTHERS == set(CHECK_VALUES)


@pytest.mark.parametrize(
    ("data", "value"),
    [
        (b"", 0x02CC5D05),
        (b"a", 0x550D7456),
        (b"abc", 0x32D153FF),
        (b"Nobody inspects the spammish repetition", 0xE2293B2F),
    ],
)
def test_xxhash32_gives_the_values_of_its_authors(data: bytes, value: int) -> None:
    assert CHECKSUMS["xxhash32"].compute(data) == value


@pytest.mark.parametrize("name", CHECK_VALUES)
def test_the_check_value_is_the_published_one(name: str) -> None:
    assert CHECKSUMS[name].compute(b"123456789") == CHECK_VALUES[name]


def bit_by_bit(name: str, data: bytes) -> int:
    polynomial, value, reflected, xor_out = PARAMETERS[name]
    width = 8 * CHECKSUMS[name].size
    for byte in data:
        for bit in range(8):
            incoming = byte >> (bit if reflected else 7 - bit) & 1
            top = value >> (width - 1) & 1
            value = (value << 1) & ((1 << width) - 1)
            if top ^ incoming:
                value ^= polynomial
    if reflected:
        value = int(f"{value:0{width}b}"[::-1], 2)
    return value ^ xor_out


@given(st.binary(max_size=40))
def test_any_bytes_give_what_the_definition_gives_bit_by_bit(data: bytes) -> None:
    for name in PARAMETERS:
        assert CHECKSUMS[name].compute(data) == bit_by_bit(name, data)


@given(st.binary(max_size=40))
def test_sums_are_those_of_another_library(data: bytes) -> None:
    assert CHECKSUMS["sum8"].compute(data) == Checksum8.calc(data)
    assert CHECKSUMS["xor8"].compute(data) == ChecksumXor8.calc(data)


def test_fletcher_16_has_the_published_values() -> None:
    """Of the article on Fletcher's checksum in Wikipedia."""
    published = {b"abcde": 0xC8F0, b"abcdef": 0x2057, b"abcdefgh": 0x0627}
    assert {data: CHECKSUMS["fletcher16"].compute(data) for data in published} == published
