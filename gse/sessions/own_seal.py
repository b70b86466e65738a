"""Seal of kept results: an HMAC under a secret of this user on this computer.

Results lie beside a session, and a session may come from anybody. A hash in the same folder proves nothing: whoever
writes results there writes it too. Results that this user's gse did not keep on this computer are derived anew. Whoever
can read the secret, such as the user himself, can seal results that were never derived: ``--anew`` derives them.
"""

import contextlib
import hashlib
import hmac
import os
import secrets
from pathlib import Path

from platformdirs import user_state_path

from drivers.host_files import CREATE

_SECRET_BYTES = 32


def seal(text: bytes) -> str:
    """The seal of a text in hexadecimal; OSError where there is no secret and none can be kept."""
    return hmac.new(_secret(), text, hashlib.sha256).hexdigest()


def is_sealed(text: bytes, stated: bytes) -> bool:
    """Whether this user on this computer sealed a text."""
    return hmac.compare_digest(seal(text).encode(), stated)


def _secret() -> bytes:
    """The secret, made at its first use: of two processes that make one, the first counts."""
    path = user_state_path("gse") / "kept-results.secret"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        _make(path)
    with path.open("rb") as file:
        secret = file.read(_SECRET_BYTES)
    if len(secret) != _SECRET_BYTES:
        raise OSError(f"{path} has not {_SECRET_BYTES} bytes; delete it")
    return secret


def _make(path: Path) -> None:
    new = path.with_name(f".{path.name}.{os.getpid()}")
    fd = os.open(new, CREATE, 0o600)
    try:
        os.write(fd, secrets.token_bytes(_SECRET_BYTES))
        with contextlib.suppress(FileExistsError):
            os.link(new, path)
    finally:
        os.close(fd)
        new.unlink()
