"""The three plugs of an external identifier: a command, a C library, a Python entry point.

All begin with one line of JSON about the sensor (gse.sensor/1). A command and an entry point then get a line per
panorama and give a line per answer; the host of a C library gets and gives the structs of gse_identifier.h. Both hosts
are files of this package that import nothing of the station.
"""

import errno
import hashlib
import importlib.metadata
import json
import math
import os
import shutil
import struct
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from drivers.outside_text import plain_line
from gse.errors import UsageError
from gse.external.answers import ExternalAnswer, Failure, FailureKind, parse_answer, parse_line
from gse.external.child import Child, Log, split_line, split_record
from gse.external.panoramas import Counts, SensorDescription
from gse.values.identifier_options import IdentifierOptions
from gse.values.panorama import MAX_OBJECTS, Panorama

# The structs of gse_identifier.h as bytes.

ABI = 1
SENSOR = struct.Struct("=4I14d")
PANORAMA = np.dtype(
    [
        *(("version", "u4"), ("frame_no", "u4"), ("utc_ns", "i8"), ("time_us", "u8"), ("exposure_us", "u4")),
        *(("count", "u4"), ("objects", "f8", (MAX_OBJECTS, 3))),
    ]
)
ANSWER = struct.Struct(f"=i4xd4I4d{16 * MAX_OBJECTS}s64s")
"""What the function returned, the time of the call in microseconds, and gse_answer."""
_MATCH = np.dtype([("star", "i8"), ("object", "u4"), ("spare", "u4")])
_LARGEST_U32 = 0xFFFFFFFF
_STATUSES = {1: "IDENTIFIED", 2: "TOO_FEW", 3: "NO_MATCH", 4: "AMBIGUOUS", 5: "SENSOR_FAULT"}


def sensor_record(sensor: SensorDescription) -> bytes:
    """The struct gse_sensor."""
    camera = sensor.camera
    units = (number for unit in (sensor.y, sensor.x, sensor.index) for number in (unit.factor, unit.zero))
    return SENSOR.pack(
        ABI,
        camera.rows,
        camera.columns,
        camera.mirrored,
        camera.focal_length_px,
        *camera.principal_point_px,
        *camera.radial_distortion,
        *camera.tangential_distortion,
        sensor.index_max,
        *units,
    )


def panorama_records(panoramas: Sequence[Panorama], counts: Counts) -> list[bytes]:
    """The structs gse_panorama."""
    rows = np.zeros(len(panoramas), PANORAMA)
    rows["version"] = ABI
    rows["frame_no"] = [panorama.frame_no & _LARGEST_U32 for panorama in panoramas]
    rows["utc_ns"] = [panorama.utc_ns for panorama in panoramas]
    rows["time_us"] = [panorama.time_us for panorama in panoramas]
    rows["exposure_us"] = [_exposure_us(panorama.exposure_s) for panorama in panoramas]
    rows["count"] = sizes = np.diff(counts.first)
    rows["objects"][np.arange(MAX_OBJECTS) < sizes[:, None]] = counts.values
    data = rows.tobytes()
    return [data[begin : begin + PANORAMA.itemsize] for begin in range(0, len(data), PANORAMA.itemsize)]


def _exposure_us(exposure_s: float) -> int:
    return min(max(round(1e6 * exposure_s), 0), _LARGEST_U32) if math.isfinite(exposure_s) else 0


def answer_document(data: bytes, frame_no: int) -> dict[str, Any] | Failure:
    """The answer in a struct gse_answer as a document of schema gse.answer/1."""
    returned, call_us, version, answered, status, matched, *numbers, matches, detail = ANSWER.unpack(data)
    if returned:
        text = f"the function returned {returned}"
        return {"frame_no": frame_no, "status": "NO_MATCH", "detail": text, "call_us": call_us}
    if version != ABI:
        text = f"answer.version is {version}: expected GSE_IDENTIFIER_ABI, {ABI}"
        return Failure(FailureKind.NONSENSE, text, in_step=True)
    if status not in _STATUSES or matched > MAX_OBJECTS:
        text = f"answer.status is {status}, answer.matched {matched}: expected 1 to 5, and 0 to {MAX_OBJECTS}"
        return Failure(FailureKind.NONSENSE, text, in_step=True)
    document = {
        "frame_no": frame_no if answered == frame_no & _LARGEST_U32 else answered,
        "status": _STATUSES[status],
        "detail": detail.partition(b"\0")[0].decode("utf-8", "replace"),
        "call_us": call_us,
    }
    ra_deg, de_deg, roll_deg, elapsed_us = numbers
    if status == 1:
        document |= {"ra_deg": ra_deg, "de_deg": de_deg}
        document |= {} if math.isnan(roll_deg) else {"roll_deg": roll_deg}
        rows = np.frombuffer(matches, _MATCH, matched)
        document["matches"] = [
            {"object": row, "star": star}
            for row, star in zip(rows["object"].tolist(), rows["star"].tolist(), strict=True)
        ]
    return document | ({} if math.isnan(elapsed_us) else {"elapsed_us": elapsed_us})


ENTRY_POINTS = "gse.identifiers"
MOST_AHEAD = 64
"""Panoramas sent before the first answer is awaited."""
_HELLO = b'"gse.identifier/1"'
_CHECK_S = 60.0
"""Time in which a library or an entry point must load: a solver with scipy takes 20 s of a busy host."""
_MOST_NAME = 100
_HOSTS = Path(__file__).parent
_START_HINTS = {
    errno.ENOENT: "; is the interpreter of its first line there?",
    errno.ENOEXEC: "; a script needs a first line with #!, a program must be one for this computer",
}


@dataclass(slots=True)
class Identity:
    """Name and version as the program states them, and the SHA-256 of its file and of its config."""

    plug: str
    name: str
    version: str
    program_sha256: str | None
    config_sha256: str | None

    def document(self) -> dict[str, Any]:
        """The JSON of schema gse.identifier/1."""
        return {"schema": "gse.identifier/1", **{name: getattr(self, name) for name in self.__slots__}}


class Plug(Protocol):
    """How a program is started, asked and understood."""

    identity: Identity

    def start(self, log: Log) -> Child:
        """Start the program; OSError where it cannot be."""
        ...

    @property
    def greeting(self) -> bytes:
        """What the program gets first."""
        ...

    def requests(self, panoramas: Sequence[Panorama]) -> list[bytes]:
        """What the program gets for each panorama."""
        ...

    def split(self, buffer: bytearray) -> bytes | None:
        """The next whole answer in the program's output."""
        ...

    def read(self, data: bytes, panorama: Panorama) -> ExternalAnswer | Failure:
        """The answer to a panorama."""
        ...


def plug_of(options: IdentifierOptions, sensor: SensorDescription) -> Plug:
    """The plug that the options name; UsageError where there is no such program, before any session."""
    named = [name for name in ("command", "library", "entry_point") if getattr(options, name) is not None]
    if len(named) != 1:
        came = " and ".join(named) or "none"
        raise UsageError(f"identifier: external needs one of command, library and entry_point; {came} came")
    directory = Path(options.directory or ".")
    if not directory.is_dir():
        raise UsageError(f"identifier.directory: {directory} is not a folder")
    config = None if options.config is None else _file(directory / options.config, "identifier.config")
    if options.command is not None:
        return CommandPlug(options.command, directory, config, sensor)
    if options.library is not None:
        library = _file(directory / options.library, "identifier.library")
        return LibraryPlug(library, options.symbol, directory, config, sensor)
    assert options.entry_point is not None
    return EntryPointPlug(options.entry_point, directory, config, sensor)


class CommandPlug:
    """A program in any language, with a line of JSON for each panorama on its standard input."""

    def __init__(
        self, command: tuple[str, ...], directory: Path, config: Path | None, sensor: SensorDescription
    ) -> None:
        self._command = (str(_program(command[0], directory)), *command[1:])
        self._directory, self._sensor = directory, sensor
        program = Path(self._command[0])
        script = _script(command, directory)
        self.identity = Identity(
            "command", (script or program).name, "not stated", _sha256(script or program), _sha256(config)
        )
        try:  # what the system refuses now, it would refuse all night
            self.start(Log(0)).close()
        except OSError as error:
            raise UsageError(f"identifier.command: {program} {start_failure(error)}") from None

    def start(self, log: Log) -> Child:
        """Start the program."""
        return Child(self._command, self._directory, log)

    @property
    def greeting(self) -> bytes:
        """The sensor's line."""
        return _line(self._sensor.document())

    def requests(self, panoramas: Sequence[Panorama]) -> list[bytes]:
        """The panoramas' lines."""
        return self._sensor.lines(panoramas)

    def split(self, buffer: bytearray) -> bytes | None:
        """The next line that is an answer; a line about the program itself is kept."""
        line = split_line(buffer)
        while line is not None and _HELLO in line[:200]:
            self._keep_hello(line)
            line = split_line(buffer)
        return line

    def _keep_hello(self, line: bytes) -> None:
        try:
            document = json.loads(line)
        except (ValueError, RecursionError):
            return
        _take_names(self.identity, document)

    def read(self, data: bytes, panorama: Panorama) -> ExternalAnswer | Failure:
        """The answer in a line."""
        return parse_line(data, panorama.frame_no, len(panorama.brightness))


class EntryPointPlug(CommandPlug):
    """A Python entry point of the group gse.identifiers, in a process of its own."""

    def __init__(self, name: str, directory: Path, config: Path | None, sensor: SensorDescription) -> None:
        found = {point.name: point.value for point in importlib.metadata.entry_points(group=ENTRY_POINTS)}
        if name not in found:
            known = ", ".join(sorted(found)) or "none"
            raise UsageError(
                f"identifier.entry_point: {name} is not installed; known in {ENTRY_POINTS}: {known}; "
                "docs/external-identifiers.md says how one is installed"
            )
        self._command = _host("entry_point_host.py", found[name], config, json.dumps(sys.path))
        self._directory, self._sensor = directory, sensor
        source = _check(self._command, directory, f"identifier.entry_point: {name}")
        self.identity = Identity("entry point", name, "not stated", _sha256(Path(source["file"])), None)
        self.identity.config_sha256 = _sha256(config)
        _take_names(self.identity, source)


class LibraryPlug(CommandPlug):
    """A function of a shared library, called in a process of its own with the structs of gse_identifier.h."""

    def __init__(
        self, library: Path, symbol: str, directory: Path, config: Path | None, sensor: SensorDescription
    ) -> None:
        self._command = _host("library_host.py", str(library), symbol, config)
        self._directory, self._sensor = directory, sensor
        self.identity = Identity("library", library.name, "not stated", _sha256(library), _sha256(config))
        _take_names(self.identity, _check(self._command, directory, f"identifier.library: {library}"))
        self._split = split_record(ANSWER.size)

    @property
    def greeting(self) -> bytes:
        """The sensor's struct."""
        return sensor_record(self._sensor)

    def requests(self, panoramas: Sequence[Panorama]) -> list[bytes]:
        """The panoramas' structs."""
        return panorama_records(panoramas, self._sensor.counts(panoramas))

    def split(self, buffer: bytearray) -> bytes | None:
        """The next whole struct."""
        return self._split(buffer)

    def read(self, data: bytes, panorama: Panorama) -> ExternalAnswer | Failure:
        """The answer in a struct."""
        document = answer_document(data, panorama.frame_no)
        return (
            document
            if isinstance(document, Failure)
            else parse_answer(document, panorama.frame_no, len(panorama.brightness))
        )


def start_failure(error: OSError) -> str:
    """Why a program cannot be started, and what to look at."""
    return f"cannot be started: {error.strerror}{_START_HINTS.get(error.errno or 0, '')}"


def _host(name: str, target: str, *arguments: object) -> tuple[str, ...]:
    texts = ["" if argument is None else str(argument) for argument in arguments]
    return (sys.executable, "-I", str(_HOSTS / name), target, *texts)


def _check(command: tuple[str, ...], directory: Path, what: str) -> dict[str, Any]:
    """What a host says of its library or entry point once it is loaded; UsageError where it cannot be."""
    try:
        child = Child((*command, "--check"), directory, Log(0))
    except OSError as error:
        raise UsageError(f"{what}: {command[0]} {start_failure(error)}") from None
    replies, failure = child.exchange((), split_line, 1, first_s=_CHECK_S, each_s=_CHECK_S)
    child.close()
    if failure is not None and failure.kind is FailureKind.TIMEOUT:
        raise UsageError(f"{what} does not load within {_CHECK_S:g} s")
    if failure is not None:
        raise UsageError(f"{what} ends the process that loads it: {failure.detail}")
    document = json.loads(replies[0].data)
    if "error" in document:
        raise UsageError(f"{what}: {plain_line(str(document['error']))[:300]}")
    return dict(document)


def _program(name: str, directory: Path) -> Path:
    """The file of a command: with a slash beside the station file, without one along PATH."""
    if "/" not in name:
        found = shutil.which(name)
        if found is None:
            raise UsageError(f"identifier.command: there is no program {name} in PATH")
        return Path(found)
    path = _file(directory / name, "identifier.command").absolute()
    if not os.access(path, os.X_OK):
        raise UsageError(f"identifier.command: {path} is not executable; chmod +x {path} makes it so")
    return path


def _script(command: tuple[str, ...], directory: Path) -> Path | None:
    """The first argument that is a file, where the program itself comes from PATH: a script for an interpreter."""
    if "/" in command[0]:
        return None
    return next((directory / part for part in command[1:] if (directory / part).is_file()), None)


def _file(path: Path, key: str) -> Path:
    if not path.is_file():
        raise UsageError(f"{key}: there is no file {path}")
    return path.absolute()


def _sha256(path: Path | None) -> str | None:
    """Of a file; None without one, or where it cannot be read."""
    if path is None:
        return None
    digest = hashlib.sha256()
    try:
        with path.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
    except OSError:
        return None
    return digest.hexdigest()


def _take_names(identity: Identity, document: Any) -> None:
    for key in ("name", "version"):
        if isinstance(document, dict) and isinstance(document.get(key), str) and document[key]:
            setattr(identity, key, plain_line(document[key])[:_MOST_NAME])


def _line(document: dict[str, Any]) -> bytes:
    return json.dumps(document, separators=(",", ":")).encode() + b"\n"
