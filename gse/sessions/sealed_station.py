"""The station file frozen in a session, with the paths in it sealed.

A session may come from anybody: what its own station file names is no reason to open a file of this host. So a path in
it is marked before anything can change the station, and what is still marked afterwards is refused.
"""

from gse.catalog.readers import GAIA
from gse.config.station import Station
from gse.errors import UsageError
from protocols import built_in_names

_SEAL = "session://"


def sealed(station: Station) -> Station:
    """The station with its catalogue and protocol marked where they are paths."""
    changes = {}
    if station.catalog != GAIA:
        changes["catalog"] = _SEAL + station.catalog
    if station.protocol not in built_in_names():
        changes["protocol"] = _SEAL + station.protocol
    return station.model_copy(update=changes) if changes else station


def unsealed(station: Station, *, has_protocol: bool, needs_catalog: bool = True) -> Station:
    """The station without marks; UsageError where a file would be opened that only the session itself names.

    ``has_protocol``: the session holds the protocol's description itself.
    """
    named = []
    if needs_catalog and station.catalog.startswith(_SEAL):
        named.append(f"the catalogue {station.catalog.removeprefix(_SEAL)}")
    if not has_protocol and station.protocol.startswith(_SEAL):
        named.append(f"the protocol {station.protocol.removeprefix(_SEAL)}")
    if named:
        raise UsageError(
            f"the session's own station file names {' and '.join(named)}, and a session opens no file of this host; "
            "give a station file that names it: --station FILE"
        )
    return station.model_copy(update={"protocol": station.protocol.removeprefix(_SEAL)})
