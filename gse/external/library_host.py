"""Host of a C library: loads it in a process of its own, and calls its function for each panorama on standard input.

Run by path, so that nothing of the station is imported. Arguments: library, symbol, config file or "", and perhaps
--check: then it says what it loaded, as one line of JSON, and ends. Standard input carries the structs of
gse_identifier.h, standard output an answer with what the function returned and the time of the call before it. What the
library itself prints goes to stderr.
"""

import ctypes
import io
import json
import os
import sys
import time
from typing import Any

_ABI = 1
_MOST_OBJECTS = 30
_NAN = float("nan")


class _Unit(ctypes.Structure):
    _fields_ = [("factor", ctypes.c_double), ("zero", ctypes.c_double)]


class _Sensor(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_uint32) for name in ("version", "rows", "columns", "mirrored")),
        ("focal_length_px", ctypes.c_double),
        *((name, ctypes.c_double * 2) for name in ("principal_point_px", "radial", "tangential")),
        ("index_max", ctypes.c_double),
        *((name, _Unit) for name in ("y", "x", "index")),
    ]


class _Panorama(ctypes.Structure):
    _fields_ = [
        ("version", ctypes.c_uint32),
        ("frame_no", ctypes.c_uint32),
        ("utc_ns", ctypes.c_int64),
        ("time_us", ctypes.c_uint64),
        ("exposure_us", ctypes.c_uint32),
        ("count", ctypes.c_uint32),
        ("objects", ctypes.c_double * (3 * _MOST_OBJECTS)),
    ]


class _Match(ctypes.Structure):
    _fields_ = [("star", ctypes.c_int64), ("object", ctypes.c_uint32), ("spare", ctypes.c_uint32)]


class _Answer(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_uint32) for name in ("version", "frame_no", "status", "matched")),
        *((name, ctypes.c_double) for name in ("ra_deg", "de_deg", "roll_deg", "elapsed_us")),
        ("matches", _Match * _MOST_OBJECTS),
        ("detail", ctypes.c_char * 64),
    ]


class _Call(ctypes.Structure):
    _fields_ = [
        ("returned", ctypes.c_int32),
        ("spare", ctypes.c_uint32),
        ("call_us", ctypes.c_double),
        ("answer", _Answer),
    ]


class _Config(ctypes.Structure):
    _fields_ = [
        ("version", ctypes.c_uint32),
        ("spare", ctypes.c_uint32),
        ("sensor", ctypes.POINTER(_Sensor)),
        ("data", ctypes.c_char_p),
        ("size", ctypes.c_uint64),
        ("state", ctypes.c_void_p),
    ]


def main() -> int:
    """Check the library, or answer panoramas until the input ends."""
    path, symbol, config_path, *check = sys.argv[1:]
    out = os.dup(1)
    os.dup2(2, 1)
    try:
        library = ctypes.CDLL(path)
        identify = _function(library, symbol)
    except (OSError, LookupError) as error:
        text = str(error).removeprefix(f"{path}: ")
        hint = "; expected a shared library for this computer" if isinstance(error, OSError) else ""
        os.write(out, json.dumps({"error": text + hint}).encode() + b"\n")
        return 1
    if check:
        names = {key: _text(library, f"gse_identifier_{key}") for key in ("name", "version")}
        os.write(out, json.dumps(names).encode() + b"\n")
        return 0
    data = None
    if config_path:
        with open(config_path, "rb") as file:
            data = file.read()
    _serve(identify, data, out)
    return 0


def _function(library: ctypes.CDLL, symbol: str) -> Any:
    """The function; LookupError where it is not there, or the library was made for another header."""
    try:
        identify = getattr(library, symbol)
    except AttributeError:
        raise LookupError(f"it has no symbol {symbol}: export int {symbol}(const gse_panorama *, ...)") from None
    try:
        abi = ctypes.c_uint32.in_dll(library, "gse_identifier_abi").value
    except ValueError:
        abi = _ABI
    if abi != _ABI:
        raise LookupError(f"it was compiled for version {abi} of gse_identifier.h; compile it for version {_ABI}")
    identify.restype = ctypes.c_int
    identify.argtypes = [ctypes.POINTER(_Panorama), ctypes.POINTER(_Answer), ctypes.POINTER(_Config)]
    return identify


def _text(library: ctypes.CDLL, name: str) -> str:
    try:
        return ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(library, name))).decode("utf-8", "replace")
    except ValueError:
        return ""


def _serve(identify: Any, data: bytes | None, out: int) -> None:
    stdin = io.BufferedReader(io.FileIO(0, closefd=False), 1 << 16)
    sensor, panorama, call = _Sensor(), _Panorama(), _Call()
    answer = call.answer
    if stdin.readinto(sensor) < ctypes.sizeof(sensor):
        return
    config = _Config(_ABI, 0, ctypes.pointer(sensor), data, len(data or b""), None)
    arguments = ctypes.byref(panorama), ctypes.byref(answer), ctypes.byref(config)
    while stdin.readinto(panorama) == ctypes.sizeof(panorama):
        ctypes.memset(arguments[1], 0, ctypes.sizeof(answer))
        answer.roll_deg = answer.elapsed_us = _NAN
        began_ns = time.perf_counter_ns()
        call.returned = identify(*arguments)
        call.call_us = (time.perf_counter_ns() - began_ns) / 1000
        os.write(out, call)


if __name__ == "__main__":
    sys.exit(main())
