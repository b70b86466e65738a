"""The sensor's parameters, as it read them back in a session: their values, their SHA-256, and how they differ.

The hash is that of the lines ``name value unit`` in the order of the description, a number in its shortest form, each
line ended by LF. So it can be made by hand, and is the same for the same values on any machine.
"""

import hashlib
from collections.abc import Iterator

from gse.station.item_table import Housekeeping
from gse.station.session_data import SessionData
from protocols import ItemValue


def parameters_of(housekeeping: Housekeeping) -> dict[str, ItemValue]:
    """The values that came last, by name; empty where none came, or the protocol has no parameters."""
    by_name = {item.name: item for item in housekeeping.items}
    seen = housekeeping.summaries
    return {name: by_name[name].value(seen[name].last) for name in housekeeping.parameters if name in seen}


def parameters_sha256(housekeeping: Housekeeping) -> str | None:
    """The hash of the parameters; None where none came."""
    found = parameters_of(housekeeping)
    units = {item.name: item.unit for item in housekeeping.items}
    lines = "".join(f"{' '.join(filter(None, (name, str(value), units[name])))}\n" for name, value in found.items())
    return hashlib.sha256(lines.encode()).hexdigest() if found else None


def parameter_differences(session: SessionData) -> Iterator[str]:
    """In which way the parameters are not those that the station file states, or did not stay the same."""
    test, housekeeping = session.station.test, session.housekeeping
    found, sha256 = parameters_of(housekeeping), parameters_sha256(housekeeping)
    if not found:
        if test.parameters_sha256 or test.parameters:
            yield "the sensor's parameters never came: send the command that reads them back in the session"
        return
    for name in found:
        seen = housekeeping.summaries[name]
        if seen.least < seen.largest:
            yield f"the parameter {name} changed in the session, from {seen.least:.6g} to {seen.largest:.6g}"
    for name, stated in test.parameters.items():
        value = found.get(name)
        if value != stated:
            yield f"the parameter {name} is {_in_words(value)}, test.parameters states {_in_words(stated)}"
    if test.parameters_sha256 is not None and sha256 != test.parameters_sha256.lower():
        yield f"the SHA-256 of the parameters is {sha256}, test.parameters_sha256 states {test.parameters_sha256}"


def _in_words(value: ItemValue | None) -> str:
    return "missing" if value is None else value if isinstance(value, str) else f"{value:.15g}"
