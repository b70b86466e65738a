"""The names by which a web server of this machine may be asked.

A request whose Host is not a name of the server is refused: a foreign page whose name was made to point here (DNS
rebinding) reads nothing, and no foreign text enters a header.
"""

import re
import socket

_HOST = re.compile(r"([A-Za-z0-9.-]+|\[[0-9a-fA-F:]+\])(?::([0-9]{1,5}))?")
_LOCAL = ("127.0.0.1", "localhost", "[::1]")
_ANY = ("0.0.0.0", "::")
_ADDRESS = re.compile(r"\d{1,3}(\.\d{1,3}){3}|\[[0-9a-fA-F:]+\]")
_SOMEWHERE = ("192.0.2.1", 9)
"""Reserved for documentation (RFC 5737): nothing is sent there."""


def host_of(asked: str, *, bind: str, port: int) -> str | None:
    """The name of this server in a Host header, without its port; None where it has no such name."""
    found = _HOST.fullmatch(asked)
    if found is None or int(found[2] or 80) != port:
        return None
    host = found[1]
    names = {*_LOCAL, bind, f"[{bind}]", socket.gethostname()}
    # A server on all addresses accepts each address as its name, but no host name, which an attacker could choose.
    is_address = bind in _ANY and _ADDRESS.fullmatch(host) is not None
    return host if host in names or is_address else None


def reachable_name(bind: str) -> str:
    """The name that a person can open: that of ``bind``, or this machine's address in its network for all addresses."""
    if bind not in _ANY:
        return bind
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(_SOMEWHERE)  # of UDP: chooses an address and sends nothing
        except OSError:
            return "127.0.0.1"
        address: str = probe.getsockname()[0]
        return address
