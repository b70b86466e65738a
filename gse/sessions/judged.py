"""Judged sessions: from kept results where session, station file and software are the same, else derived and kept."""

import contextlib
import hashlib
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drivers.mock.playback import is_session
from drivers.session_file.reader import segment_files, session_file
from gse.catalog.readers import GAIA
from gse.config.choice import StationText
from gse.errors import UsageError
from gse.recording.session_format import read_attachments
from gse.report.result_key import ResultKey, session_sha256, software_sha256
from gse.sessions.kept_results import KeptResultsError, keep, kept, results_folder
from gse.sessions.replay import Replay, StationInForce, station_in_force
from gse.sessions.sealed_station import names_program
from gse.sessions.status_file import is_running, read_status
from gse.station.session_data import SessionData
from gse.verdict.assessment import Assessment, judge
from protocols import built_in_names

Change = Callable[[StationText], StationText]


@dataclass(frozen=True, slots=True)
class Judged:
    """A session and its assessment; ``own_elapsed_us`` are this host's identification times, none of kept results."""

    session: SessionData
    assessment: Assessment
    own_elapsed_us: "array[float]"


@dataclass(frozen=True, slots=True)
class _Place:
    """Where results of a session are kept, and what they follow from."""

    folder: Path
    key: ResultKey
    force: StationInForce


def judged_session(
    path: Path, *, station: Change, derive: Callable[[], Replay], tell: Callable[[str], None], anew: bool = False
) -> Judged:
    """The session of a recording and its assessment, from kept results, or from ``derive`` and then kept.

    ``station`` changes the recorded station, as ``derive`` does. ``tell`` gets a line about the results that are used,
    or why they are not. ``anew`` uses none. Results of a recording that has no station of its own, of one that is
    still written, or of a station file that names files besides itself are not kept: such a file may change. Nor are
    any where this user has no cache directory.
    """
    place = _place(path, station)
    session = _kept(place, tell) if place and not anew else None
    return _derived(place, derive, tell) if session is None else Judged(session, judge(session), array("d"))


def session_alone(
    path: Path, *, station: Change, derive: Callable[[], Replay], tell: Callable[[str], None], anew: bool = False
) -> SessionData:
    """The session of ``judged_session`` without its assessment: of kept results nothing is judged again."""
    place = _place(path, station)
    session = _kept(place, tell) if place and not anew else None
    return _derived(place, derive, tell).session if session is None else session


def _derived(place: _Place | None, derive: Callable[[], Replay], tell: Callable[[str], None]) -> Judged:
    replay = derive()
    assessment = judge(replay.session)
    if place:
        _keep(replay.session, assessment, place, tell)
    return Judged(replay.session, assessment, replay.own_elapsed_us)


def _kept(place: _Place, tell: Callable[[str], None]) -> SessionData | None:
    try:
        session = kept(place.key, place.folder, place.force.station, place.force.text)
    except KeptResultsError as error:
        tell(f"{error}; derived anew")
        return None
    if session is not None:
        tell(f"results kept in {place.folder} are used")
    elif place.folder.is_dir():
        tell("derived anew: the session, its station file or gse changed since results were kept")
    return session


def _keep(session: SessionData, assessment: Assessment, place: _Place, tell: Callable[[str], None]) -> None:
    try:
        keep(session, assessment, place.key, place.folder)
    except OSError as error:
        tell(f"results cannot be kept in {place.folder}: {error.strerror or error}")


def keep_live(session: SessionData, assessment: Assessment, path: Path, tell: Callable[[str], None]) -> None:
    """Keep the results of the session file at ``path``, which was closed just now."""
    place = None
    with contextlib.suppress(UsageError):  # a session alone names no file of this host, and nothing is kept of such
        place = _place_of(path, lambda recorded: recorded)
    if place:
        _keep(session, assessment, place, tell)


def _place(path: Path, station: Change) -> _Place | None:
    if not path.exists() or not is_session(path) or (path.is_file() and path.stat().st_size == 0):
        return None
    status = read_status(session_file(path).parent)
    return None if status is not None and is_running(status) else _place_of(path, station)


def _place_of(path: Path, station: Change) -> _Place | None:
    first = session_file(path)
    force = station_in_force(read_attachments(path), station)
    folder = results_folder(first) if _follows_from_text(force) else None
    return _Place(folder, result_key(first, force.text), force) if folder else None


def _follows_from_text(force: StationInForce) -> bool:
    """Whether the station file says all: no catalogue, protocol or program in a file of its own."""
    station = force.station
    has_protocol = force.protocol_text is not None or station.protocol in built_in_names()
    runs_program = station.identifier.algorithm == "external" and not names_program(station)
    return has_protocol and station.catalog == GAIA and not runs_program


def result_key(first: Path, station_text: str) -> ResultKey:
    """The key of the results of a session file, with its segments, under a station file and this software."""
    station = hashlib.sha256(station_text.encode()).hexdigest()
    return ResultKey(session_sha256(segment_files(first)), station, software_sha256())
