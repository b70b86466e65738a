"""Ports of this machine to serve on."""

import socket

from gse.errors import UsageError


def free_port(bind: str) -> int:
    """A free TCP port on an IPv4 address of this machine; UsageError for another address.

    rerun only prints an error when its port is taken.
    """
    with socket.socket() as probe:
        try:
            probe.bind((bind, 0))
        except OSError as error:
            raise UsageError(
                f"cannot serve on {bind}: {error.strerror}; expected an IPv4 address of this machine"
            ) from error
        port: int = probe.getsockname()[1]
        return port
