"""Buckets of an S3 server: what boto3 wrote is read, what is written boto3 reads, and what goes wrong is told."""

import gc
import http.server
import os
import ssl
import subprocess
import sys
import threading
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from urllib.request import Request, urlopen

import fsspec.config
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from devices.patience import PATIENCE_S
from devices.proxy import Proxy
from devices.s3_server import BUCKET, S3Server, s3_server

from gse.campaign.dataset import DataSet
from gse.campaign.sources import find_sources
from gse.campaign.storage import StorageError, copy_here, open_storage, put_file_whole, put_whole, read_whole
from gse.errors import UsageError

pytestmark = pytest.mark.cluster

PART_BYTES = 10 << 20
"""What Arrow sends at once of a large file."""


@pytest.fixture(scope="module")
def server() -> Iterator[S3Server]:
    with s3_server() as server:
        yield server


@pytest.fixture
def s3(server: S3Server, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> S3Server:
    """The server with an empty bucket, and its address and credentials in the environment."""
    server.empty()
    monkeypatch.setenv("HOME", str(tmp_path))
    for name, value in server.environment.items():
        monkeypatch.setenv(name, value)
    return server


def found(url: str) -> list[str]:
    return [source.url.removeprefix(f"s3://{BUCKET}/") for source in find_sources([url])]


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ("", ["a+b %41 é=x.mcap", "a.mcap", "in/[x].mcap", "in/a#b.mcap", "in/deep/q?.mcap"]),
        ("/in", ["in/[x].mcap", "in/a#b.mcap", "in/deep/q?.mcap"]),
        ("/in/", ["in/[x].mcap", "in/a#b.mcap", "in/deep/q?.mcap"]),
        ("/*.mcap", ["a+b %41 é=x.mcap", "a.mcap"]),
        ("/i*", ["in/[x].mcap", "in/a#b.mcap", "in/deep/q?.mcap"]),
        ("/**/?*.mcap", ["a+b %41 é=x.mcap", "a.mcap", "in/[x].mcap", "in/a#b.mcap", "in/deep/q?.mcap"]),
        ("/in/a#b.mcap", ["in/a#b.mcap"]),
        ("/in/[x].mcap", ["in/[x].mcap"]),
        ("/in/deep/q?.mcap", ["in/deep/q?.mcap"]),
        ("/a+b %41 é=x.mcap", ["a+b %41 é=x.mcap"]),
    ],
)
def test_sessions_are_found_by_folder_glob_and_name(s3: S3Server, asked: str, expected: list[str]) -> None:
    for name in ("a", "a.part2", "a+b %41 é=x", "in/a#b", "in/deep/q?", "in/[x]"):
        s3.put(f"{name}.mcap", b"session")
    s3.put("notes.txt", b"no session")
    assert found(f"s3://{BUCKET}{asked}") == expected


def test_a_thousand_sessions_and_more_are_found(s3: S3Server) -> None:
    s3.fill(f"in/{number % 7}/{number}.mcap" for number in range(1001))
    assert len(found(f"s3://{BUCKET}/in")) == 1001


def test_the_state_of_a_session_changes_with_it(s3: S3Server) -> None:
    s3.put("a.mcap", b"one")
    (before,) = find_sources([f"s3://{BUCKET}/a.mcap"])
    s3.put("a.mcap", b"more")
    (after,) = find_sources([f"s3://{BUCKET}/a.mcap"])
    assert before.state.startswith("3 20")
    assert after.state.startswith("4 20")


@pytest.mark.parametrize(
    ("name", "size"),
    [("plain", 0), ("sensor=a b%2F/night=2026-03-20/é+#?.parquet", 5), ("plain", 2 * PART_BYTES + 1)],
)
def test_a_file_is_written_as_boto_reads_it_and_read_as_boto_wrote_it(
    s3: S3Server, tmp_path: Path, name: str, size: int
) -> None:
    data = bytes(range(256)) * (size // 256 + 1)
    (tmp_path / "here").write_bytes(data[:size])
    fs, root = open_storage(f"s3://{BUCKET}")
    put_file_whole(fs, root, name, tmp_path / "here")
    assert s3.read(name) == data[:size]
    put_whole(fs, root, name, data[1 : size + 1])
    assert s3.read(name) == data[1 : size + 1]
    s3.put(name, data[:size])
    copy_here(fs, f"{root}/{name}", tmp_path / "copy")
    assert (tmp_path / "copy").read_bytes() == data[:size]
    assert read_whole(fs, f"{root}/{name}", 3) == data[: min(size, 3)]
    assert s3.names() == [name]


@pytest.mark.parametrize("refused", [b"?uploads", b"partNumber=1", b"partNumber=3", b"POST /nights/old?uploadId"])
def test_an_upload_of_which_a_part_fails_leaves_the_file_that_was_there(
    s3: S3Server, refused: bytes, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    s3.put("old", b"as it was")
    (tmp_path / "here").write_bytes(bytes(3 * PART_BYTES))
    with Proxy(s3.port, refuses=refused) as proxy:
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{proxy.port}")
        fs, root = open_storage(f"s3://{BUCKET}")
        with pytest.raises(OSError, match="NETWORK_CONNECTION"):
            put_file_whole(fs, root, "old", tmp_path / "here")
        del fs
        gc.collect()
        assert proxy.refused >= 1
    assert s3.names() == ["old"]
    assert s3.read("old") == b"as it was"


def test_a_download_that_breaks_in_the_middle_is_an_error_and_no_shorter_file(
    s3: S3Server, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    s3.put("session.mcap", bytes(3 * PART_BYTES) + b"the cable is cut here" + bytes(PART_BYTES))
    with Proxy(s3.port, refuses=b"the cable is cut here") as proxy:
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{proxy.port}")
        fs, root = open_storage(f"s3://{BUCKET}")
        with pytest.raises(OSError, match="NETWORK_CONNECTION"):
            copy_here(fs, f"{root}/session.mcap", tmp_path / "copy")
        del fs
        gc.collect()
        assert proxy.refused >= 1


def test_what_is_not_there_is_named(s3: S3Server, gse, tmp_path: Path) -> None:
    with pytest.raises(StorageError, match=f"there is no s3://{BUCKET}/none"):
        found(f"s3://{BUCKET}/none")
    with pytest.raises(StorageError, match="there is no s3://no-such-bucket/in"):
        found("s3://no-such-bucket/in")
    with pytest.raises(UsageError, match=r"no data set can be made in .*: there is no such bucket or folder"):
        DataSet.at("s3://no-such-bucket/dataset", create=True)
    with pytest.raises(UsageError, match="there is no data set in"):
        DataSet.at(f"s3://{BUCKET}/none")
    fs, root = open_storage(f"s3://{BUCKET}")
    assert read_whole(fs, f"{root}/none", 10) is None


def test_no_server_is_told_in_a_sentence(s3: S3Server, gse, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with Proxy(s3.port) as proxy:
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{proxy.port}")
    done = gse("campaign", "judge", f"s3://{BUCKET}/in", "--to", tmp_path / "dataset")
    assert (done.code, f"s3://{BUCKET}/in cannot be reached" in done.err) == (3, True)
    monkeypatch.setenv("AWS_ENDPOINT_URL", "127.0.0.1:9000")
    done = gse("campaign", "judge", f"s3://{BUCKET}/in", "--to", tmp_path / "dataset")
    assert (done.code, "expected for example http://10.0.0.7:9000" in " ".join(done.err.split())) == (2, True)


@pytest.fixture
def user(s3: S3Server) -> Iterator[dict[str, str]]:
    """The server asks for credentials now; those of a user whom it knows."""
    iam = s3.client("iam")
    name = f"station-{len(iam.list_users()['Users'])}"
    iam.create_user(UserName=name)
    policy = '{"Version":"2012-10-17","Statement":[{"Effect":"Allow","Action":"s3:*","Resource":"*"}]}'
    iam.put_user_policy(UserName=name, PolicyName="all", PolicyDocument=policy)
    key = iam.create_access_key(UserName=name)["AccessKey"]
    ask_for_credentials(s3, after=0)
    yield {"AWS_ACCESS_KEY_ID": key["AccessKeyId"], "AWS_SECRET_ACCESS_KEY": key["SecretAccessKey"]}
    ask_for_credentials(s3, after=float("inf"))


def ask_for_credentials(s3: S3Server, *, after: float) -> None:
    request = Request(f"{s3.url}/moto-api/reset-auth", str(after).encode(), {"Content-Type": "text/plain"})
    with urlopen(request, timeout=PATIENCE_S):
        pass


@pytest.mark.parametrize("wrong", ["AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"])
def test_a_wrong_key_is_refused_and_no_key_is_shown(
    s3: S3Server, user: dict[str, str], wrong: str, gse, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name, value in user.items():
        monkeypatch.setenv(name, value)
    DataSet.at(f"s3://{BUCKET}/dataset", create=True)
    given = user | {wrong: "W" * 40}
    monkeypatch.setenv(wrong, given[wrong])
    for arguments in (("judge", f"s3://{BUCKET}/in", "--to", tmp_path / "x"), ("report", f"s3://{BUCKET}/dataset")):
        done = gse("campaign", *arguments)
        assert (done.code, "refused the credentials, or access" in done.err) == (3, True), done.err
        assert not any(value in done.err + done.out for value in given.values())


def test_credentials_come_from_a_profile_or_from_fsspec_too(
    s3: S3Server, user: dict[str, str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in user:
        monkeypatch.delenv(name)
    key, secret = user.values()
    (tmp_path / ".aws").mkdir()
    (tmp_path / ".aws" / "credentials").write_text(
        f"[default]\naws_access_key_id = wrong\naws_secret_access_key = wrong\n"
        f"[roof]\naws_access_key_id = {key}\naws_secret_access_key = {secret}\n"
    )
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / ".aws" / "credentials"))
    monkeypatch.setenv("AWS_PROFILE", "roof")
    DataSet.at(f"s3://{BUCKET}/dataset", create=True)
    monkeypatch.delenv("AWS_PROFILE")
    monkeypatch.delenv("AWS_ENDPOINT_URL")
    monkeypatch.setitem(fsspec.config.conf, "s3", {"key": key, "secret": secret, "endpoint_url": s3.url})
    assert DataSet.at(f"s3://{BUCKET}/dataset").committed() == []
    monkeypatch.setitem(fsspec.config.conf, "s3", {"keys": key})
    with pytest.raises(UsageError, match="FSSPEC_S3: keys is not an option of S3; expected key, secret"):
        DataSet.at(f"s3://{BUCKET}/dataset")


def test_a_url_with_a_key_in_it_is_refused_and_not_repeated(s3: S3Server) -> None:
    with pytest.raises(UsageError, match="no credentials belong into the URL of a bucket") as refused:
        found(f"s3://key:secret@{BUCKET}/in")
    assert "secret" not in str(refused.value)


def test_a_proxy_of_the_environment_is_used_and_can_be_left_out(s3: S3Server, monkeypatch: pytest.MonkeyPatch) -> None:
    s3.put("a.mcap", b"session")
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.99:9")
    monkeypatch.setenv("http_proxy", f"127.0.0.1:{s3.port}")  # moto answers whatever the host
    assert found(f"s3://{BUCKET}/a.mcap") == ["a.mcap"]
    monkeypatch.setenv("no_proxy", "127.0.0.99")
    with pytest.raises(StorageError, match="cannot be reached"):
        found(f"s3://{BUCKET}/a.mcap")


def test_a_server_whose_certificate_is_of_an_own_authority_is_trusted_by_its_file(
    s3: S3Server, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    s3.put("a.mcap", b"session")
    with Proxy(s3.port, tls=own_certificate(tmp_path / "ca.pem")) as proxy:
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"https://127.0.0.1:{proxy.port}")
        with pytest.raises(StorageError, match="cannot be reached"):
            found(f"s3://{BUCKET}")
        monkeypatch.setenv("AWS_CA_BUNDLE", str(tmp_path / "ca.pem"))
        assert found(f"s3://{BUCKET}") == ["a.mcap"]


def own_certificate(path: Path) -> ssl.SSLContext:
    """A server's side of TLS with a certificate that signs itself; written to a file."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "store")])
    address = x509.SubjectAlternativeName([x509.IPAddress(ip_address("127.0.0.1"))])
    now = datetime.now(UTC)
    certificate = (
        x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(days=1))
        .add_extension(address, critical=False)
        .sign(key, hashes.SHA256())
    )
    path.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
    private = path.with_suffix(".key")
    private.write_bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(path, private)
    return context


class MetadataService(http.server.BaseHTTPRequestHandler):
    """Stands in the place of 169.254.169.254, has nothing, and counts."""

    asked: list[str]

    def do_GET(self) -> None:
        self.asked.append(self.path)
        self.send_error(404)

    def do_PUT(self) -> None:
        self.do_GET()

    def log_message(self, *told: object) -> None:
        pass


@pytest.mark.parametrize("wanted", [False, True])
def test_without_credentials_no_metadata_service_is_asked_unless_it_is_wanted(
    s3: S3Server, tmp_path: Path, wanted: bool
) -> None:
    handler = type("Handler", (MetadataService,), {"asked": []})
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as service:
        threading.Thread(target=service.serve_forever, daemon=True).start()
        env = {name: value for name, value in os.environ.items() if not name.startswith("AWS_")} | {
            "AWS_ENDPOINT_URL": s3.url,
            "AWS_EC2_METADATA_SERVICE_ENDPOINT": f"http://127.0.0.1:{service.server_port}",
            **({"AWS_EC2_METADATA_DISABLED": "false"} if wanted else {}),
        }
        command = (sys.executable, "-m", "gse", "campaign", "judge", f"s3://{BUCKET}/in", "--to", tmp_path / "dataset")
        done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
        service.shutdown()
    assert (done.returncode, f"there is no s3://{BUCKET}/in" in done.stderr) == (3, True), done.stderr
    assert bool(handler.asked) == wanted
