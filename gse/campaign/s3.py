"""S3 buckets, by pyarrow's own file system of S3.

Arrow completes an upload when its stream is closed, and closes a stream that nobody needs any more. So a file is handed
to it in one write: after an error of this program between two of them, the first alone would be the file. Where a part
of an upload failed, closing fails and leaves no file; with Arrow's ``allow_delayed_open`` it may leave an empty one.

AWS's library asks the metadata service of a virtual machine (169.254.169.254) for credentials and for a region where it
finds none elsewhere. Here it does so only with AWS_EC2_METADATA_DISABLED=false: nothing leaves this machine unasked.
"""

import errno
import functools
import os
import threading
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any
from urllib.parse import urlsplit

import pyarrow as pa
from fsspec.implementations.arrow import ArrowFSWrapper
from pyarrow.fs import AwsStandardS3RetryStrategy, FileSelector, S3FileSystem, resolve_s3_region

from gse.errors import UsageError

OPTIONS = ("key", "secret", "token", "endpoint_url", "anon")
_ATTEMPTS = 3
_SILENCE_S = 60.0
"""A server that does not answer for so long, over all attempts, is gone."""
_CONNECT_S = 5.0
"""A connection takes a tenth of a second around the world."""
_METADATA = "AWS_EC2_METADATA_DISABLED"
_environment = threading.Lock()


class S3(ArrowFSWrapper):  # type: ignore[misc]
    """A bucket's server as fsspec sees storage; ``bucket`` is the one whose region counts.

    ``options`` are those of FSSPEC_S3 (OPTIONS), named as in s3fs. What they leave open is taken from AWS's variables
    and files.
    """

    protocol = "s3"
    cachable = False  # credentials and endpoint may be others next time

    def __init__(self, bucket: str, **options: Any) -> None:
        wrong = set(options).difference(OPTIONS)
        if wrong:
            raise UsageError(f"FSSPEC_S3: {min(wrong)} is not an option of S3; expected {', '.join(OPTIONS)}")
        endpoint = options.get("endpoint_url") or _variable("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL")
        with _without_metadata_service():
            super().__init__(
                S3FileSystem(
                    access_key=options.get("key"),
                    secret_key=options.get("secret"),
                    session_token=options.get("token"),
                    anonymous=bool(options.get("anon")),
                    region=_variable("AWS_REGION", "AWS_DEFAULT_REGION") or (None if endpoint else _region_of(bucket)),
                    connect_timeout=_CONNECT_S,
                    request_timeout=_SILENCE_S / _ATTEMPTS,
                    retry_strategy=AwsStandardS3RetryStrategy(max_attempts=_ATTEMPTS),
                    **_server(endpoint),
                )
            )

    @classmethod
    def _strip_protocol(cls, path: str) -> str:
        return path.removeprefix("s3://").rstrip("/")

    def find(
        self, path: str, maxdepth: int | None = None, withdirs: bool = False, detail: bool = False, **others: Any
    ) -> Any:
        """What is below a folder: of all depths by one question for each thousand, where fsspec asks for each folder.

        FileNotFoundError where there is no such folder.
        """
        with _no_bucket_is_no_file():
            if maxdepth is not None:
                return super().find(path, maxdepth=maxdepth, withdirs=withdirs, detail=detail, **others)
            entries = self.fs.get_file_info(FileSelector(self._strip_protocol(path), recursive=True))
        found = {entry["name"]: entry for entry in map(self._make_entry, entries)}
        kept = {name: found[name] for name in sorted(found) if withdirs or found[name]["type"] == "file"}
        return kept if detail else list(kept)

    def pipe_file(self, path: str, value: bytes, **others: Any) -> None:
        """Write bytes as a file, whole or not at all."""
        self._put(path, pa.py_buffer(value))

    def put_file(self, lpath: str, rpath: str, **others: Any) -> None:
        """Copy a file of this host, whole or not at all; it is mapped, never held in memory."""
        self._put(rpath, pa.memory_map(lpath).read_buffer() if os.path.getsize(lpath) else pa.py_buffer(b""))

    def _put(self, path: str, data: pa.Buffer) -> None:
        with _no_bucket_is_no_file():
            stream = self.fs.open_output_stream(self._strip_protocol(path), compression=None)
            try:
                stream.write(data)
            finally:
                stream.close()


def _server(endpoint: str | None) -> dict[str, Any]:
    """Where Arrow finds the server, and by which proxy; UsageError where the endpoint is no URL."""
    if endpoint is None:
        scheme, host, server = "https", "s3.amazonaws.com", {}
    else:
        parts = urlsplit(endpoint)
        if parts.scheme not in ("http", "https") or not parts.hostname or parts.username is not None:
            raise UsageError(
                "AWS_ENDPOINT_URL is not the address of a server; expected for example http://10.0.0.7:9000"
            )
        scheme, host = parts.scheme, parts.netloc
        server = {"scheme": scheme, "endpoint_override": host + parts.path.rstrip("/")}
    proxy = urllib.request.getproxies().get(scheme)
    if proxy and not urllib.request.proxy_bypass(host):
        server["proxy_options"] = proxy if "://" in proxy else f"http://{proxy}"
    certificates = _variable("AWS_CA_BUNDLE")
    return server | ({"tls_ca_file_path": certificates} if certificates else {})


@functools.lru_cache(maxsize=16)
def _region_of(bucket: str) -> str | None:
    """What AWS says; None where it cannot be asked: then the region is that of ~/.aws/config, or us-east-1."""
    with suppress(OSError):
        return str(resolve_s3_region(bucket))
    return None


def _variable(*names: str) -> str | None:
    return next((os.environ[name] for name in names if os.environ.get(name)), None)


@contextmanager
def _without_metadata_service() -> Iterator[None]:
    """AWS's library reads the variable where a file system is made: after that it has the value that it had."""
    if _METADATA in os.environ:
        yield
        return
    with _environment:
        os.environ[_METADATA] = "true"
        try:
            yield
        finally:
            del os.environ[_METADATA]


@contextmanager
def _no_bucket_is_no_file() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if "NO_SUCH_BUCKET" in str(error):
            raise FileNotFoundError(errno.ENOENT, "there is no such bucket") from error
        raise
