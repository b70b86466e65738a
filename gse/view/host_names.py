"""The names by which a web server of this machine may be asked.

A request whose Host is not a name of the server is refused: a foreign page whose name was made to point here (DNS
rebinding) reads nothing, and no foreign text enters a header. The port is not compared: behind a tunnel
(ssh -L 9000:localhost:8420) it is another one, and a foreign page has a foreign name at every port.
"""

import functools
import re
import socket
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

_HOST = re.compile(r"([A-Za-z0-9.-]+|\[[0-9a-fA-F:]+\])(?::[0-9]{1,5})?")
_LOCAL = ("127.0.0.1", "localhost", "[::1]")
_LOOPBACK = ("127.0.0.1", "localhost", "::1")
_ANY = ("0.0.0.0", "::")
_ADDRESS = re.compile(r"\d{1,3}(\.\d{1,3}){3}|\[[0-9a-fA-F:]+\]")
_HOSTS_FILE = Path("/etc/hosts")
_SOMEWHERE = ("192.0.2.1", 9)
"""Reserved for documentation (RFC 5737): nothing is sent there."""


def host_of(asked: str, *, bind: str) -> str | None:
    """A Host header, in small letters, if it is a name of this server with any port; else None."""
    found = _HOST.fullmatch(asked)
    if found is None:
        return None
    name = found[1].lower()
    names = {*_LOCAL, bind.lower(), f"[{bind}]".lower(), socket.gethostname().lower()}
    # No other machine asks a server on loopback, and any machine of the network can call itself by a .local name.
    if bind not in _LOOPBACK:
        names |= _names_of_this_machine()
    # A server on all addresses accepts each address as its name, but no host name, which an attacker could choose.
    is_address = bind in _ANY and _ADDRESS.fullmatch(name) is not None
    return asked.lower() if name in names or is_address else None


def names_of_machine(host_name: str, hosts_lines: Iterable[str]) -> frozenset[str]:
    """The names of a machine in small letters: its host name, with .local (mDNS), with the domain of its hosts file.

    A name server is not asked: it may be somebody else's, and nothing leaves the machine unasked.
    """
    host_name = host_name.lower()
    first = host_name.partition(".")[0]
    listed = (name.lower() for line in hosts_lines for name in line.partition("#")[0].split()[1:])
    return frozenset({host_name, first, f"{first}.local", *(name for name in listed if name.startswith(f"{first}."))})


@functools.cache
def _names_of_this_machine() -> frozenset[str]:
    lines: list[str] = []
    with suppress(OSError, UnicodeDecodeError):
        lines = _HOSTS_FILE.read_text(encoding="utf-8").splitlines()
    return names_of_machine(socket.gethostname(), lines)


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
