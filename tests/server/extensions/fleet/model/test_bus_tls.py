"""A fleet over TLS: robots with passwords, or with certificates of their own."""

from __future__ import annotations

import datetime
import re
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from imuscope.server.extensions.fleet.model import keys
from imuscope.server.extensions.fleet.model.bus import BusCredentials
from imuscope.server.extensions.fleet.model.reports import RobotReport, RobotStatus, encode
from tests.server.extensions.fleet.fleet_robot import FleetRobot
from tests.support.free_ports import free_port
from tests.support.server_process import ServerProcess
from tests.support.timeouts import get
from tests.support.waiting import block_until

START = datetime.datetime(2020, 1, 1, tzinfo=datetime.UTC)
END = datetime.datetime(2120, 1, 1, tzinfo=datetime.UTC)


class Authority:
    """An authority that signs certificates, in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "fleet authority")])
        builder = self._builder(self._name, self._key).add_extension(x509.BasicConstraints(True, None), critical=True)
        self.certificate = self._write("ca.pem", builder.sign(self._key, hashes.SHA256()))

    def _builder(self, name: x509.Name, key: ec.EllipticCurvePrivateKey) -> x509.CertificateBuilder:
        builder = x509.CertificateBuilder().subject_name(name).issuer_name(self._name).public_key(key.public_key())
        return builder.serial_number(x509.random_serial_number()).not_valid_before(START).not_valid_after(END)

    def _write(self, name: str, certificate: x509.Certificate) -> str:
        path = self.folder / name
        path.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
        return str(path)

    def sign(self, name: str) -> tuple[str, str]:
        """Files of a certificate for a name and of its key."""
        key = ec.generate_private_key(ec.SECP256R1())
        builder = self._builder(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)]), key)
        alternatives = x509.SubjectAlternativeName([x509.DNSName(name)])
        signed = builder.add_extension(alternatives, critical=False).sign(self._key, hashes.SHA256())
        path = self.folder / f"{name}.key"
        plain = serialization.NoEncryption()
        path.write_bytes(key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, plain))
        return self._write(f"{name}.pem", signed), str(path)


@pytest.fixture
def authority(tmp_path: Path) -> Authority:
    return Authority(tmp_path)


def serve_fleet(bus: str, tmp_path: Path, authority: Authority, robots: str, *more: str) -> ServerProcess:
    path = tmp_path / "robots.txt"
    path.write_text(robots)
    certificate, key = authority.sign("localhost")
    files = ("--robots", str(path), "--bus-certificate", certificate, "--bus-key", key, *more)
    return ServerProcess(data=tmp_path / "data", arguments=("--listen", bus, *files), command="fleet")


def versions(server: ServerProcess) -> dict[str, str]:
    """Versions of the robots that are live."""
    robots = get(f"{server.url}/api/fleet/robots").json()["robots"]
    return {one["name"]: one["version"] for one in robots if one["state"] == "live"}


def reports(server: ServerProcess) -> dict[str, int]:
    """Reports received, by what became of them."""
    lines = get(f"{server.url}/metrics").text
    matches = re.findall(r'imuscope_fleet_reports_total{result="(\w+)"} (\d+)', lines)
    return {result: int(count) for result, count in matches}


def test_robots_join_over_tls_with_passwords(tmp_path: Path, authority: Authority) -> None:
    bus = f"tls/localhost:{free_port()}"
    credentials = BusCredentials(user="a", password="password-of-a", ca=authority.certificate)
    with (
        serve_fleet(bus, tmp_path, authority, "a:password-of-a\n") as server,
        FleetRobot("a", bus, credentials) as robot,
    ):
        block_until(robot.opened.is_set, "the robot is connected")
        robot.report(1)
        block_until(lambda: versions(server) == {"a": "1.0"}, "the robot reports")


def test_a_certificate_gives_a_robot_its_own_name_only(tmp_path: Path, authority: Authority) -> None:
    bus = f"tls/localhost:{free_port()}"
    files = {name: authority.sign(name) for name in ("a", "b", "stranger")}

    def member(name: str) -> FleetRobot:
        certificate, key = files[name]
        credentials = BusCredentials(ca=authority.certificate, certificate=certificate, key=key)
        robot = FleetRobot(name, bus, credentials)
        block_until(robot.opened.is_set, f"{name} is connected")
        return robot

    with (
        serve_fleet(bus, tmp_path, authority, "a\nb\n", "--bus-ca", authority.certificate) as server,
        member("a") as a,
        member("b") as b,
        member("stranger") as stranger,
    ):
        for robot in (a, b):  # a report may overtake its robot's token; the journal that is asked for then has it
            robot.report(1)
        block_until(lambda: versions(server) == {"a": "1.0", "b": "1.0"}, "the reports of a and b have arrived")
        assert a.session is not None
        a.session.put(keys.report_key("b"), encode(RobotReport(b.journal.boot, 2, 0.0, status=RobotStatus("forged"))))
        stranger.report(1)
        a.put(a.journal.report(1_700_000_001.0, RobotStatus("1.1")))
        block_until(lambda: versions(server).get("a") == "1.1", "what a sent after it has arrived")
        assert versions(server) == {"a": "1.1", "b": "1.0"}
        counts = reports(server)
        assert counts["valid"] + counts["unannounced"] <= 3, "what a forged, and the stranger sent, was passed on"
