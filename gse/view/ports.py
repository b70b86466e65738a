"""Ports of this machine to serve on."""

import socket


def free_port(bind: str) -> int:
    """A TCP port that is free now on an address: rerun only prints an error when its port is not."""
    with socket.socket(socket.AF_INET6 if ":" in bind else socket.AF_INET) as probe:
        probe.bind((bind, 0))
        port: int = probe.getsockname()[1]
        return port
