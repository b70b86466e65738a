"""SFTP to servers whose keys are in ssh's known_hosts."""

from pathlib import Path
from typing import Any

import paramiko
from fsspec.implementations.sftp import SFTPFileSystem

SILENCE_S = 60.0
"""An SFTP server that does not answer for so long is gone."""


class KnownHostsSFTP(SFTPFileSystem):  # type: ignore[misc]
    """fsspec's SFTP that refuses servers which ssh does not know, and gives up on silent ones.

    ``known_hosts`` is a file instead of the user's own, for example in FSSPEC_SFTP_KNOWN_HOSTS.
    """

    def __init__(self, host: str, known_hosts: str | None = None, **ssh_kwargs: Any) -> None:
        self._known_hosts = known_hosts
        super().__init__(host, **{"timeout": SILENCE_S, **ssh_kwargs, "host_key_policy": "reject"})

    def _connect(self) -> None:
        self.client = paramiko.SSHClient()
        if self._known_hosts:
            self.client.load_host_keys(str(Path(self._known_hosts).expanduser()))
        else:
            self.client.load_system_host_keys()
        self.client.set_missing_host_key_policy(self.host_key_policy)
        self.client.connect(self.host, **self.ssh_kwargs)
        self.ftp = self.client.open_sftp()
        self.ftp.get_channel().settimeout(SILENCE_S)
