"""Storage by fsspec: folders here, on an SFTP server, or in an S3 bucket.

A file is written whole or not at all: under another name and then renamed where the storage can rename (a folder, an
SFTP server), by one upload where it cannot (S3). Storage that fails for a while is asked again by tenacity, up to
PATIENCE_S; a wrong name, refused credentials and a full disk are errors at once.

Credentials come from where fsspec, AWS's library and ssh look for them (docs/campaigns.md); none is ever written to a
data set.
"""

import errno
import logging
import os
import shutil
import socket
import uuid
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import fsspec
import tenacity
from fsspec.core import url_to_fs

from drivers.outside_text import without_password
from gse.errors import CampaignError, UsageError

PROTOCOLS = ("file", "sftp", "ssh", "s3")
PATIENCE_S = 180.0
"""A server is restarted in less."""
COPIED_AT_ONCE = 1 << 20
PARTS = ".parts"
"""Folder of unfinished files, beside the tables, so that a reader of a table never meets one."""

_RENAMES = ("file", "local", "sftp", "ssh")
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_LASTING = (*_FULL, errno.EROFS, errno.ELOOP, errno.ENAMETOOLONG)
_REFUSED = ("AuthenticationException", "BadHostKeyException")
_REFUSED_TEXTS = (
    "not found in known_hosts",
    "INVALID_ACCESS_KEY_ID",
    "SIGNATURE_DOES_NOT_MATCH",
    "ACCESS_DENIED",
    "ExpiredToken",
    "InvalidToken",
)
_ELSEWHERE = "(HTTP status 301)"
"""A bucket of another region, which Arrow names."""

_given_up: set[str] = set()
"""Servers that failed for PATIENCE_S: else each of a thousand sessions would wait as long for one that is gone."""

_T = TypeVar("_T")


class StorageError(CampaignError):
    """Storage that cannot be read or written, with its ``url``; ``is_full`` where it has no room left."""

    def __init__(self, text: str, url: str = "", *, is_full: bool = False) -> None:
        super().__init__(text)
        self.url = url
        self.is_full = is_full


def open_storage(url: str) -> tuple[Any, str]:
    """The file system of a URL or local path, and the path on it; StorageError where it cannot be reached."""
    protocol = protocol_of(url)
    if protocol != "file" and not url.split("://", 1)[1].split("/", 1)[0]:
        raise UsageError(f"{url} names no server; expected for example sftp://user@host/folder or s3://bucket/folder")
    if protocol == "s3" and "@" in url.split("/", 3)[2]:
        raise UsageError(
            "no credentials belong into the URL of a bucket; docs/campaigns.md says where they are read from"
        )
    if protocol != "file" and without_password(url) != url:
        raise UsageError(
            f"{without_password(url)} has a password, which every user of this computer sees in its list of processes; "
            "docs/campaigns.md says where keys and passwords are read from"
        )
    if protocol in ("sftp", "ssh"):
        _use_known_hosts()
    try:
        fs, path = _bucket(url) if protocol == "s3" else url_to_fs(url)
    except ImportError as error:
        raise UsageError(
            f"{url} needs a package that is not installed ({error}); pip install 'gse-star-sensor[campaign]'"
        ) from error
    except UsageError:
        raise
    except FileNotFoundError as error:  # of a key or of known_hosts: the path of the URL was not looked at yet
        raise StorageError(
            f"{url} cannot be reached: {error}; docs/campaigns.md says where keys and credentials are read from", url
        ) from error
    except Exception as error:
        raise explained(error, url) from error
    return fs, str(path).rstrip("/")


def protocol_of(url: str) -> str:
    """file, sftp, ssh or s3; UsageError for anything else that fsspec knows."""
    protocol = url.split("://", 1)[0] if "://" in url else "file"
    if protocol not in PROTOCOLS or "::" in url:
        raise UsageError(f"{url}: {protocol} is not a storage of campaigns; expected a path, sftp:// or s3://")
    return protocol


def with_patience(url: str, act: Callable[[Any, str], _T]) -> _T:
    """What ``act`` returns of a URL's file system and path; tried again, newly connected, while the storage fails.

    A server that failed for so long once is asked only once, until it answers.
    """
    server = "/".join(url.split("/", 3)[:3]) if "://" in url else ""
    asked = tenacity.Retrying(
        stop=tenacity.stop_after_attempt(1) if server in _given_up else tenacity.stop_after_delay(PATIENCE_S),
        wait=tenacity.wait_random_exponential(multiplier=0.5, max=10.0),
        retry=tenacity.retry_if_exception(_may_pass),
        before_sleep=lambda state: _forget_connections(url),
        reraise=True,
    )
    try:
        done = asked(lambda: act(*open_storage(url)))
    except Exception as error:
        if _may_pass(error):
            _given_up.add(server)
        if isinstance(error, CampaignError) or not _is_of_storage(error):
            raise
        raise explained(error, url) from error
    _given_up.discard(server)
    return done


def find_files(fs: Any, folder: str) -> dict[str, dict[str, Any]]:
    """All files below a folder, with what the storage tells of each; FileNotFoundError where there is no such folder.

    By itself fsspec leaves out what it cannot list, also where the connection is gone.
    """
    found: dict[str, dict[str, Any]] = fs.find(
        folder, detail=True, **({"on_error": "raise"} if _can_rename(fs) else {})
    )
    return found


def put_whole(fs: Any, root: str, name: str, data: bytes) -> None:
    """Write a file below a folder: whole, in one step, over an older one of the same name."""
    path = f"{root}/{name}"
    if not _can_rename(fs):
        fs.pipe_file(path, data)
        return
    _put_renamed(fs, root, path, lambda file: file.write(data))


def put_file_whole(fs: Any, root: str, name: str, here: Path) -> None:
    """The same with a file of this host, which is never held whole where the storage can rename."""
    path = f"{root}/{name}"
    if not _can_rename(fs):
        fs.put_file(str(here), path)
        return
    with here.open("rb") as source:
        _put_renamed(fs, root, path, lambda file: shutil.copyfileobj(source, file, COPIED_AT_ONCE))


def _put_renamed(fs: Any, root: str, path: str, write: Callable[[Any], object]) -> None:
    part = f"{root}/{PARTS}/{uuid.uuid4().hex}"
    for folder in (part, path):
        fs.makedirs(folder.rsplit("/", 1)[0], exist_ok=True)
    try:
        with fs.open(part, "wb") as file:
            write(file)
            if "file" in _protocols(fs):
                file.flush()
                os.fsync(file.fileno())
        fs.mv(part, path)
    except BaseException:
        with suppress(Exception):
            fs.rm_file(part)
        raise


def copy_here(fs: Any, path: str, here: Path) -> None:
    """Copy a file of any storage to this host."""
    with fs.open(path, "rb") as source, here.open("wb") as copy:
        while data := source.read(COPIED_AT_ONCE):
            try:
                copy.write(data)
            except OSError as error:
                raise explained(error, f"{here.parent} of {socket.gethostname()}") from error


def read_whole(fs: Any, path: str, most_bytes: int) -> bytes | None:
    """A small file, None where there is none; at most ``most_bytes`` of it."""
    try:
        with fs.open(path, "rb") as file:
            return bytes(file.read(most_bytes))
    except FileNotFoundError:
        return None


def explained(error: Exception, url: str) -> StorageError:
    """An error of a storage for a person."""
    number = getattr(error, "errno", None)
    told = str(error).strip() or type(error).__name__
    if number in _FULL:
        return StorageError(f"no room is left under {url}; make room", url, is_full=True)
    if isinstance(error, FileNotFoundError):
        return StorageError(f"there is no {url}", url)
    if isinstance(error, NotADirectoryError | IsADirectoryError) or number in (errno.EROFS, errno.ELOOP):
        return StorageError(f"{url} cannot be used: {told:.300}", url)
    if _is_refused(error):
        return StorageError(
            f"{url} refused the credentials, or access ({told:.200}); docs/campaigns.md says where they are read from",
            url,
        )
    return StorageError(f"{url} cannot be reached: {told:.300}", url)


def _may_pass(error: BaseException) -> bool:
    """Whether an error may be gone in a moment."""
    if isinstance(error, StorageError):
        return isinstance(error.__cause__, Exception) and _may_pass(error.__cause__)
    if isinstance(error, FileNotFoundError | PermissionError | IsADirectoryError | NotADirectoryError):
        return False
    lasts = getattr(error, "errno", None) in _LASTING or _is_refused(error) or _ELSEWHERE in str(error)
    return _is_of_storage(error) and not lasts


def _is_of_storage(error: BaseException) -> bool:
    return isinstance(error, OSError | EOFError) or type(error).__module__.startswith("paramiko")


def _is_refused(error: BaseException) -> bool:
    told = str(error)
    return (
        isinstance(error, PermissionError)
        or type(error).__name__ in _REFUSED
        or any(text in told for text in _REFUSED_TEXTS)
    )


def _forget_connections(url: str) -> None:
    with suppress(Exception):
        fsspec.get_filesystem_class(protocol_of(url)).clear_instance_cache()


def _can_rename(fs: Any) -> bool:
    return any(name in _RENAMES for name in _protocols(fs))


def _protocols(fs: Any) -> tuple[str, ...]:
    return (fs.protocol,) if isinstance(fs.protocol, str) else tuple(fs.protocol)


def _bucket(url: str) -> tuple[Any, str]:
    import gse.campaign.s3  # starts AWS's library

    path = url.removeprefix("s3://")
    return gse.campaign.s3.S3(path.split("/", 1)[0]), path


def _use_known_hosts() -> None:
    """SFTP to hosts that ssh knows only: fsspec's own default trusts whoever answers first."""
    import gse.campaign.known_hosts

    logging.getLogger("paramiko").setLevel(logging.CRITICAL)  # it prints the traceback of what it raises
    fsspec.register_implementation("sftp", gse.campaign.known_hosts.KnownHostsSFTP, clobber=True)
    fsspec.register_implementation("ssh", gse.campaign.known_hosts.KnownHostsSFTP, clobber=True)
