"""Checksums by name.

    name                 bytes  polynomial  init      reflected  xor-out   check value of ASCII "123456789"
    none                 0      frames without a checksum
    sum8                 1      sum of the bytes, modulo 256                  DD
    xor8                 1      exclusive or of the bytes                     31
    fletcher16           2      two sums modulo 255, the second one high      1EDE
    crc8                 1      07          00        no         00        F4 (CRC-8/SMBUS)
    crc8-maxim           1      31          00        yes        00        A1
    crc8-sae-j1850       1      1D          FF        no         FF        4B
    crc16-ccitt-false    2      1021        FFFF      no         0000      29B1 (CRC-16/IBM-3740)
    crc16-xmodem         2      1021        0000      no         0000      31C3
    crc16-genibus        2      1021        FFFF      no         FFFF      D64E
    crc16-mcrf4xx        2      1021        FFFF      yes        0000      6F91
    crc16-x25            2      1021        FFFF      yes        FFFF      906E (CRC-16/IBM-SDLC)
    crc16-kermit         2      1021        0000      yes        0000      2189
    crc16-modbus         2      8005        FFFF      yes        0000      4B37
    crc16-arc            2      8005        0000      yes        0000      BB3D
    crc24-openpgp        3      864CFB      B704CE    no         000000    21CF02
    crc24-ble            3      00065B      555555    yes        000000    C25A56
    crc32                4      04C11DB7    FFFFFFFF  yes        FFFFFFFF  CBF43926
    crc32-iscsi          4      1EDC6F41    FFFFFFFF  yes        FFFFFFFF  E3069283
    crc32-mpeg-2         4      04C11DB7    FFFFFFFF  no         00000000  0376E6E7
    xxhash32             4      no CRC: xxHash, XXH32 with seed 0             937BAD67

Names, parameters and check values of the CRCs as in the catalogue of parametrised CRC algorithms (CRC RevEng). fastcrc
computes those of 8, 16 and 32 bits; no library that is fast has 24 bits.
"""

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from operator import xor
from types import MappingProxyType

import xxhash
from fastcrc import crc8, crc16, crc32


@dataclass(frozen=True, slots=True)
class Checksum:
    """A checksum: how many bytes it takes on the wire, and how it is computed."""

    name: str
    size: int
    compute: Callable[[bytes], int]


def _fletcher16(data: bytes) -> int:
    low = high = 0
    for byte in data:
        low = (low + byte) % 255
        high = (high + low) % 255
    return high << 8 | low


def _crc24(polynomial: int, init: int, *, reflected: bool) -> Callable[[bytes], int]:
    """By a table of one byte's remainders."""
    if reflected:
        polynomial, init = (int(f"{number:024b}"[::-1], 2) for number in (polynomial, init))
    table = []
    for byte in range(256):
        value = byte if reflected else byte << 16
        for _ in range(8):
            if reflected:
                value = value >> 1 ^ (polynomial if value & 1 else 0)
            else:
                value = (value << 1 ^ (polynomial if value >> 23 else 0)) & 0xFFFFFF
        table.append(value)

    def compute(data: bytes) -> int:
        value = init
        for byte in data:
            if reflected:
                value = value >> 8 ^ table[(value ^ byte) & 0xFF]
            else:
                value = value << 8 & 0xFFFFFF ^ table[value >> 16 ^ byte]
        return value

    return compute


CHECKSUMS: Mapping[str, Checksum] = MappingProxyType(
    {
        checksum.name: checksum
        for checksum in (
            Checksum("crc32", 4, zlib.crc32),
            Checksum("crc16-ccitt-false", 2, crc16.ibm_3740),
            Checksum("crc16-xmodem", 2, crc16.xmodem),
            Checksum("crc16-genibus", 2, crc16.genibus),
            Checksum("crc16-mcrf4xx", 2, crc16.mcrf4xx),
            Checksum("crc16-x25", 2, crc16.ibm_sdlc),
            Checksum("crc16-kermit", 2, crc16.kermit),
            Checksum("crc16-modbus", 2, crc16.modbus),
            Checksum("crc16-arc", 2, crc16.arc),
            Checksum("crc8", 1, crc8.smbus),
            Checksum("crc8-maxim", 1, crc8.maxim_dow),
            Checksum("crc8-sae-j1850", 1, crc8.sae_j1850),
            Checksum("crc24-openpgp", 3, _crc24(0x864CFB, 0xB704CE, reflected=False)),
            Checksum("crc24-ble", 3, _crc24(0x00065B, 0x555555, reflected=True)),
            Checksum("crc32-iscsi", 4, crc32.iscsi),
            Checksum("crc32-mpeg-2", 4, crc32.mpeg_2),
            Checksum("xxhash32", 4, xxhash.xxh32_intdigest),
            Checksum("sum8", 1, lambda data: sum(data) & 0xFF),
            Checksum("xor8", 1, lambda data: reduce(xor, data, 0)),
            Checksum("fletcher16", 2, _fletcher16),
            Checksum("none", 0, lambda data: 0),
        )
    }
)
"""Every checksum that a description can name."""
