"""Station file of a session, with its paths sealed.

A session may come from anybody, so its own station file must not open files of this host, nor start a program. Paths
and programs in it are marked first. A path still marked after the operator's changes is refused; of a program still
marked the recorded answers are judged.
"""

from dataclasses import replace

from gse.catalog.readers import GAIA
from gse.config.station import Station
from gse.errors import UsageError
from protocols import built_in_names

_SEAL = "session://"


def sealed(station: Station) -> Station:
    """The station with its catalogue and protocol marked where they are paths."""
    changes: dict[str, object] = {}
    if station.catalog != GAIA:
        changes["catalog"] = _SEAL + station.catalog
    if station.protocol not in built_in_names():
        changes["protocol"] = _SEAL + station.protocol
    if station.identifier.algorithm == "external":
        changes["identifier"] = replace(station.identifier, directory=_SEAL)
    if station.power is not None:  # a session switches nothing on this host
        changes["power"] = station.power.model_copy(update={"on": (_SEAL,), "off": (_SEAL,), "read": ()})
    return station.model_copy(update=changes) if changes else station


def names_program(station: Station) -> bool:
    """Whether only the session itself names the external identifier."""
    return station.identifier.algorithm == "external" and station.identifier.directory == _SEAL


def unsealed(station: Station, *, has_protocol: bool, needs_catalog: bool = True) -> Station:
    """The station without marks; UsageError where only the session itself names a file that is needed.

    ``has_protocol``: the session holds the protocol's description itself.
    """
    paths = []
    if needs_catalog and station.catalog.startswith(_SEAL):
        paths.append(f"the catalogue {station.catalog.removeprefix(_SEAL)}")
    if not has_protocol and station.protocol.startswith(_SEAL):
        paths.append(f"the protocol {station.protocol.removeprefix(_SEAL)}")
    if paths:
        raise UsageError(
            f"the session's own station file names {' and '.join(paths)}, and a session opens no file of this host; "
            "give a station file that names it: --station FILE"
        )
    return station.model_copy(update={"protocol": station.protocol.removeprefix(_SEAL)})
