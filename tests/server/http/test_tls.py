"""HTTPS: with a generated certificate, with a given one, and errors for neither."""

from __future__ import annotations

import asyncio
import contextlib
import datetime
import hashlib
import ssl
import sys
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization

from imuscope.server.http import server as http_server
from imuscope.server.http import tls
from imuscope.server.http.connections import ConnectionLimits
from imuscope.server.settings.config import Config, ConfigError, load
from tests.support.each_row import each_row
from tests.support.server_process import imuscope
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import until

PEM = serialization.Encoding.PEM
DAY = datetime.timedelta(days=1)


def days_on(monkeypatch: pytest.MonkeyPatch, days: float) -> None:
    """Move the clock that certificates are judged by."""
    now = datetime.datetime.now(datetime.UTC) + days * DAY
    monkeypatch.setattr(tls, "_now", lambda: now)


# ── a certificate of our own ──


def test_a_generated_certificate_names_its_hosts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tls.platform, "node", lambda: "Robot.example")
    monkeypatch.setattr(tls, "addresses", lambda: ["10.0.0.7", "fd00::7"])
    config = Config(data=tmp_path, tls=True, host="192.0.2.9", allowed_hosts=("fleet.example",))
    result = tls.tls_of(config)
    certificate = x509.load_pem_x509_certificate(result.cert.read_bytes())
    held = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    names = {"localhost", "robot.example", "robot", "robot.local", "fleet.example"}
    assert set(held.get_values_for_type(x509.DNSName)) == names
    there = {str(address) for address in held.get_values_for_type(x509.IPAddress)}
    assert there == {"127.0.0.1", "::1", "10.0.0.7", "fd00::7", "192.0.2.9"}
    assert certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca is False
    assert (
        result.fingerprint
        == hashlib.sha256(ssl.PEM_cert_to_DER_cert(result.cert.read_text())).digest().hex(":").upper()
    )
    assert result.key.stat().st_mode & 0o777 == 0o600
    assert result.key.parent.stat().st_mode & 0o777 == 0o700


def test_the_certificate_is_generated_once_and_renewed_before_expiry(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = tls.ensure_self_signed(tmp_path, ["localhost", "10.0.0.7"])
    first.key.chmod(0o644)
    assert tls.ensure_self_signed(tmp_path, ["localhost", "10.0.0.8"]) == first  # an address appears and disappears
    assert first.key.stat().st_mode & 0o777 == 0o600
    days_on(monkeypatch, tls.CERTIFICATE_DAYS - tls.RENEW_DAYS - 1)
    assert tls.ensure_self_signed(tmp_path, ["localhost"]) == first
    days_on(monkeypatch, tls.CERTIFICATE_DAYS - tls.RENEW_DAYS + 1)
    second = tls.ensure_self_signed(tmp_path, ["localhost"])
    assert second.fingerprint != first.fingerprint
    third = tls.ensure_self_signed(tmp_path, ["localhost", "robot.local"])
    assert third.fingerprint != second.fingerprint
    third.cert.write_text("half a cert")  # a power cut, a disk
    assert tls.ensure_self_signed(tmp_path, ["localhost"]).fingerprint not in (second.fingerprint, third.fingerprint)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["certificate.pem", "key.pem"]


def test_addresses_are_this_machines_own() -> None:
    results = tls.addresses()
    assert all(tls._address(one) is not None for one in results)
    if sys.platform == "linux":
        assert "127.0.0.1" in results


# ── a certificate that is given ──


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tls.Tls:
    return tls.ensure_self_signed(tmp_path_factory.mktemp("pair"), ["localhost", "127.0.0.1"])


def test_a_given_certificate_is_used(pair: tls.Tls) -> None:
    result = tls.tls_of(Config(tls_cert=str(pair.cert), tls_key=str(pair.key)))
    assert result == replace(pair, made=False)


@each_row(
    ("what", "words"),
    [
        ("no certificate file", "tls_cert .*gone.pem cannot be read: No such file or directory."),
        ("no key file", "tls_key .*gone.pem cannot be read: No such file or directory."),
        ("a folder", "tls_cert .* cannot be read: Is a directory."),
        ("no certificate", "holds no certificate in PEM form"),
        ("no key", "holds no private key in PEM form"),
        ("swapped", "holds no certificate in PEM form"),
        ("another key", "is not the key of the certificate"),
        ("passphrase", "has a passphrase; give one without"),
        ("expired", "has expired on 20"),
        ("not yet", "is valid from 20.*; it is 20.* here"),
    ],
)
def test_unusable_certificates_are_reported(
    what: str, words: str, pair: tls.Tls, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cert, key, gone, text = pair.cert, pair.key, tmp_path / "gone.pem", tmp_path / "text.pem"
    text.write_text("-----BEGIN NOTHING-----\n")
    match what:
        case "no certificate file":
            cert = gone
        case "no key file":
            key = gone
        case "a folder":
            cert = tmp_path
        case "no certificate":
            cert = text
        case "no key":
            key = text
        case "swapped":
            cert, key = key, cert
        case "another key":
            key = tls.ensure_self_signed(tmp_path / "other", ["localhost"]).key
        case "passphrase":
            secret = serialization.load_pem_private_key(key.read_bytes(), None)
            key = tmp_path / "locked.pem"
            lock = serialization.BestAvailableEncryption(b"secret")
            key.write_bytes(secret.private_bytes(PEM, serialization.PrivateFormat.PKCS8, lock))
        case "expired":
            days_on(monkeypatch, tls.CERTIFICATE_DAYS + 1)
        case "not yet":
            days_on(monkeypatch, -2)
    with pytest.raises(ConfigError, match=words):
        tls.load_certificate(cert, key)


@each_row(
    ("case", "words"),
    [
        ({"tls_cert": "a.pem"}, "tls_cert needs tls_key"),
        ({"tls_key": "a.pem"}, "tls_key needs tls_cert"),
        ({"tls": True, "tls_cert": "a.pem", "tls_key": "b.pem"}, "one of the two"),
        ({"tls": "yes"}, "tls must be"),
    ],
)
def test_inconsistent_settings(case: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load(None, **case)


def test_the_command_reports_it_in_one_line(tmp_path: Path) -> None:
    """Before anything is compiled or opened."""
    arguments = ("--tls-cert", str(tmp_path / "a.pem"), "--tls-key", "b.pem", "--port", "0", "--data", str(tmp_path))
    done = imuscope("serve", "udp://127.0.0.1:0", *arguments)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.splitlines()[-1] == (
        f"imuscope: tls_cert {tmp_path / 'a.pem'} cannot be read: No such file or directory."
    )
    assert "Traceback" not in done.stderr


# ── a server ──


@contextlib.asynccontextmanager
async def serving_with(keeper: tls.CertificateManager, limits: ConnectionLimits | None = None) -> AsyncIterator[int]:
    """A trivial application with this certificate; returns its port."""

    async def nothing(scope: Any, receive: Any, send: Any) -> None:
        while scope["type"] == "lifespan":
            message = await receive()
            await send({"type": message["type"] + ".complete"})
            if message["type"] == "lifespan.shutdown":
                return

    listener, ready = http_server.listen("127.0.0.1", 0), asyncio.Event()
    server = http_server.server(nothing, ready.set, keeper, limits)
    task = asyncio.create_task(server.serve(sockets=[listener]))
    await ready.wait()
    try:
        yield listener.getsockname()[1]
    finally:
        server.should_exit = True
        await task
        listener.close()


async def shown(port: int, trust: Path) -> str:
    """The fingerprint of the certificate that a client who trusts this one is shown."""
    context = ssl.create_default_context(cafile=trust)
    _, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context, server_hostname="localhost")
    connection: ssl.SSLObject = writer.get_extra_info("ssl_object")
    der = connection.getpeercert(binary_form=True)
    assert der is not None
    assert connection.version() in ("TLSv1.2", "TLSv1.3")
    writer.close()
    await writer.wait_closed()
    return hashlib.sha256(der).digest().hex(":").upper()


async def test_a_certificate_that_is_renewed_needs_no_restart(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    old = tls.ensure_self_signed(tmp_path / "old", ["localhost"])
    new = tls.ensure_self_signed(tmp_path / "new", ["localhost"])
    config = Config(tls_cert=str(tmp_path / "cert.pem"), tls_key=str(tmp_path / "key.pem"))

    def install(cert: Path, key: Path) -> None:
        Path(config.tls_cert).write_bytes(cert.read_bytes())
        Path(config.tls_key).write_bytes(key.read_bytes())

    install(old.cert, old.key)
    keeper = tls.CertificateManager(config)
    viewers = asyncio.create_task(http_server.watch_certificate(keeper, 0.02))
    async with serving_with(keeper) as port:
        assert await shown(port, old.cert) == old.fingerprint
        install(new.cert, old.key)  # half way
        await until(lambda: "was not replaced" in caplog.text, "it is tried")
        assert await shown(port, old.cert) == old.fingerprint
        install(new.cert, new.key)
        await until(lambda: keeper.tls.fingerprint == new.fingerprint, "it is replaced")
        assert await shown(port, new.cert) == new.fingerprint
    viewers.cancel()


# ── a handshake that does not end ──


async def closed(reader: asyncio.StreamReader) -> bool:
    """Wait until the other side has closed a connection; not for so long as asyncio waits by itself, a minute."""
    with contextlib.suppress(ConnectionError):
        async with asyncio.timeout(PATIENCE_S / 2):
            assert await reader.read(100) == b""
    return True


async def test_a_handshake_that_does_not_end_is_not_waited_for(tmp_path: Path) -> None:
    """Regression: connections with no or half a handshake were kept for a minute."""
    keeper = tls.CertificateManager(Config(data=tmp_path, tls=True))
    async with serving_with(keeper, ConnectionLimits(handshake_s=0.3)) as port:
        for message in (b"", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03"):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(message)
            assert await closed(reader)
            writer.close()
        fingerprint = ""
        async with asyncio.timeout(PATIENCE_S):
            while not fingerprint:  # on a busy machine this handshake may be late, too
                with contextlib.suppress(OSError):
                    fingerprint = await shown(port, keeper.tls.cert)
        assert fingerprint == keeper.tls.fingerprint


async def test_handshakes_that_do_not_end_leave_room_for_one_that_does(tmp_path: Path) -> None:
    """They were counted nowhere: about a thousand, without a token, took every descriptor of a server with TLS."""
    keeper = tls.CertificateManager(Config(data=tmp_path, tls=True))
    async with serving_with(keeper, ConnectionLimits(handshake_s=PATIENCE_S, most=10)) as port:
        silent = [await asyncio.open_connection("127.0.0.1", port) for _ in range(30)]
        assert all([await closed(reader) for reader, _ in silent[:20]])
        assert await shown(port, keeper.tls.cert) == keeper.tls.fingerprint
        assert not any(reader.at_eof() for reader, _ in silent[-5:])
        for _, writer in silent:
            writer.close()


async def test_a_server_ends_without_waiting_for_handshakes(tmp_path: Path) -> None:
    def shaking() -> bool:
        return any(task.get_name() == "TLS handshake" for task in asyncio.all_tasks())

    keeper = tls.CertificateManager(Config(data=tmp_path, tls=True))
    async with serving_with(keeper, ConnectionLimits(handshake_s=PATIENCE_S)) as port:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(b"\x16\x03\x01\x02\x00")
        async with asyncio.timeout(PATIENCE_S):
            while not shaking():
                await asyncio.sleep(0.01)
    assert await closed(reader)
    writer.close()
    await asyncio.sleep(0)
    assert not shaking()
