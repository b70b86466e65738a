"""An S3 server as a device under test: moto's, on loopback."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import boto3
from moto.core import DEFAULT_ACCOUNT_ID
from moto.s3.models import s3_backends
from moto.server import ThreadedMotoServer

BUCKET = "nights"


@dataclass
class S3Server:
    """Its port, and an administrator of it (boto3, which shares no code with the station)."""

    port: int
    admin: Any = field(init=False)

    def __post_init__(self) -> None:
        self.admin = self.client("s3")

    def client(self, service: str) -> Any:
        """One of boto3's clients."""
        return boto3.client(
            service,
            endpoint_url=self.url,
            aws_access_key_id="admin",
            aws_secret_access_key="admin",
            region_name="us-east-1",
        )

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    @property
    def environment(self) -> dict[str, str]:
        """What a process needs to use it."""
        return {
            "AWS_ENDPOINT_URL": self.url,
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_DEFAULT_REGION": "us-east-1",
        }

    def put(self, name: str, data: bytes) -> None:
        """Write a file of the bucket."""
        self.admin.put_object(Bucket=BUCKET, Key=name, Body=data)

    def read(self, name: str) -> bytes:
        """A file of the bucket."""
        return bytes(self.admin.get_object(Bucket=BUCKET, Key=name)["Body"].read())

    def names(self) -> list[str]:
        """The files of the bucket."""
        return [one["Key"] for one in self.admin.list_objects_v2(Bucket=BUCKET).get("Contents", ())]

    def fill(self, names: Iterable[str]) -> None:
        """Empty files of the bucket, put into the server itself: a thousand requests take seconds."""
        for name in names:
            s3_backends[DEFAULT_ACCOUNT_ID]["aws"].put_object(BUCKET, name, b"")

    def empty(self) -> None:
        """Delete all files of the bucket."""
        while names := self.names():
            self.admin.delete_objects(Bucket=BUCKET, Delete={"Objects": [{"Key": name} for name in names]})


@contextmanager
def s3_server() -> Iterator[S3Server]:
    """A server with one empty bucket, which takes any credentials."""
    moto = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    moto.start()
    try:
        server = S3Server(moto.get_host_and_port()[1])
        server.admin.create_bucket(Bucket=BUCKET)
        yield server
    finally:
        moto.stop()
