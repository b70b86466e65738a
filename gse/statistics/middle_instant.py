"""The instant that stands for a session wherever truth is asked for one."""

from gse.station.clock_steps import instants_ns
from gse.station.session_data import SessionData
from gse.truth.orientation import FIRST_NS


def middle_instant_ns(session: SessionData) -> int | None:
    """UTC of the middle one of the frames that no wrong clock stamped; None without frames, or where none has truth.

    A clock that is set to 1970 in the session, and stays there, is the last one and so counts as right.
    """
    utc_ns = instants_ns(session.frames.columns, session.events)
    utc_ns = utc_ns[utc_ns >= FIRST_NS]
    return int(utc_ns[len(utc_ns) // 2]) if len(utc_ns) else None
