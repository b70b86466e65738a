"""Checksums by name.

    name                width  polynomial  init      reflected  xor-out   check value of ASCII "123456789"
    crc32               32     04C11DB7    FFFFFFFF  yes        FFFFFFFF  CBF43926
    crc16-ccitt-false   16     1021        FFFF      no         0000      29B1
    crc16-xmodem        16     1021        0000      no         0000      31C3
    crc16-genibus       16     1021        FFFF      no         FFFF      D64E
    crc16-mcrf4xx       16     1021        FFFF      yes        0000      6F91
    crc16-x25           16     1021        FFFF      yes        FFFF      906E
    crc16-kermit        16     1021        0000      yes        0000      2189
    crc16-modbus        16     8005        FFFF      yes        0000      4B37
    xxhash32            32     no CRC: xxHash, XXH32 with seed 0                  937BAD67

Names, parameters and check values of the CRCs as in the catalogue of parametrised CRC algorithms (CRC RevEng).
"""

import binascii
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import xxhash

_REVERSED_BITS = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


@dataclass(frozen=True, slots=True)
class Checksum:
    """A checksum: how many bytes it takes on the wire, and how it is computed."""

    name: str
    size: int
    compute: Callable[[bytes], int]


def _plain_1021(init: int, xor_out: int) -> Callable[[bytes], int]:
    return lambda data: binascii.crc_hqx(data, init) ^ xor_out


def _reflected_1021(init: int, xor_out: int) -> Callable[[bytes], int]:
    # crc_hqx shifts left; a reflected CRC is the same sum over bytes whose bits are reversed, with its bits reversed.
    def compute(data: bytes) -> int:
        high, low = divmod(binascii.crc_hqx(data.translate(_REVERSED_BITS), init), 256)
        return (_REVERSED_BITS[low] << 8 | _REVERSED_BITS[high]) ^ xor_out

    return compute


def _reflected_table(polynomial_reversed: int) -> tuple[int, ...]:
    table = []
    for value in range(256):
        for _ in range(8):
            value = value >> 1 ^ (polynomial_reversed if value & 1 else 0)
        table.append(value)
    return tuple(table)


def _modbus(data: bytes, table: tuple[int, ...] = _reflected_table(0xA001)) -> int:
    value = 0xFFFF
    for byte in data:
        value = value >> 8 ^ table[(value ^ byte) & 0xFF]
    return value


CHECKSUMS: Mapping[str, Checksum] = MappingProxyType(
    {
        checksum.name: checksum
        for checksum in (
            Checksum("crc32", 4, zlib.crc32),
            Checksum("crc16-ccitt-false", 2, _plain_1021(0xFFFF, 0)),
            Checksum("crc16-xmodem", 2, _plain_1021(0, 0)),
            Checksum("crc16-genibus", 2, _plain_1021(0xFFFF, 0xFFFF)),
            Checksum("crc16-mcrf4xx", 2, _reflected_1021(0xFFFF, 0)),
            Checksum("crc16-x25", 2, _reflected_1021(0xFFFF, 0xFFFF)),
            Checksum("crc16-kermit", 2, _reflected_1021(0, 0)),
            Checksum("crc16-modbus", 2, _modbus),
            Checksum("xxhash32", 4, xxhash.xxh32_intdigest),
        )
    }
)
"""Every checksum that a description can name."""
