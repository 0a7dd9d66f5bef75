"""Access to the bus of a fleet: which robots may connect, and which keys each may use.

    otter-7:a-long-password        a line of the file of robots: name and password, as Zenoh's dictionary has them
    heron-2                        … or the name alone, which is then the common name of its client certificate

From the file follow the access rules of the router: a robot may put its own reports, answer for its own journal and
announce itself, request the time of the fleet server, and receive requests for its own pages. Everything else is
denied: other names, reading anything of another robot, and requests to the pages of another robot. Removing a line
revokes a robot.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imuscope.server.extensions.fleet.model import keys
from imuscope.server.extensions.fleet.model.bus import MAX_SESSIONS, SETTINGS, is_loopback_address

MIN_PASSWORD = 12


class FleetAccessError(ValueError):
    """A file of robots, or an address, that cannot be used: the reason as one sentence."""


@dataclass(frozen=True, slots=True)
class RobotCredentials:
    """The robots that may connect.

    Args:
        names: in order of the file.
        have_passwords: they show a password; otherwise a certificate.
    """

    path: Path
    names: Sequence[str]
    have_passwords: bool


def read_robots(path: Path) -> RobotCredentials:
    """The robots of a file.

    Raises:
        FleetAccessError: it cannot be read, or a line is not valid.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise FleetAccessError(f"The file of robots {str(path)!r} cannot be read: {error}.") from None
    names, passwords = [], 0
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        name, colon, password = line.partition(":")
        if not keys.is_robot_name(name):
            raise FleetAccessError(f"Line {number} of {path}: {name!r:.80} is not a name: use {keys.NAME_RULE}.")
        if name in names:
            raise FleetAccessError(f"Line {number} of {path}: {name} is listed twice.")
        if colon and len(password) < MIN_PASSWORD:
            words = f"the password of {name} is too short; give it {MIN_PASSWORD} characters or more"
            raise FleetAccessError(f"Line {number} of {path}: {words}.")
        names.append(name)
        passwords += bool(colon)
    if passwords not in (0, len(names)):
        raise FleetAccessError(f"{path}: give every robot a password, or none, when they show certificates.")
    return RobotCredentials(path, names, bool(passwords) or not names)


def access_rules(robots: RobotCredentials) -> dict[str, Any]:
    """`access_control` of a Zenoh router."""

    def rule(name: str, flow: str, messages: Sequence[str], *keys: str) -> dict[str, Any]:
        return {"id": name, "flows": [flow], "permission": "allow", "messages": list(messages), "key_exprs": list(keys)}

    common = [
        rule("queries to the fleet server", "ingress", ["query"], f"{keys.FLEET}/**"),
        rule("answers of the fleet server", "egress", ["reply", "declare_queryable"], f"{keys.FLEET}/**"),
        rule("subscribers of reports", "egress", ["declare_subscriber"], keys.ALL_REPORTS, keys.ALL_ANSWERS),
    ]
    rules, subjects, policies = list(common), [], []
    shown = "usernames" if robots.have_passwords else "cert_common_names"
    for name in robots.names:
        own = f"{keys.ROBOTS}/{name}/**"
        writes = ("put", "declare_queryable", "reply", "liveliness_token")
        requests = keys.request_key(name)
        its = [
            rule(f"{name} writes", "ingress", writes, own),
            rule(f"requests to {name}", "egress", ["query"], own),
            rule(f"{name} listens", "ingress", ["declare_subscriber"], requests),
            rule(f"requests to the pages of {name}", "egress", ["put"], requests),
        ]
        rules += its
        subjects.append({"id": name, shown: [name]})
        mine = [one["id"] for one in (*common, *its)]
        policies.append({"rules": mine, "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects or None,
        "policies": policies or None,
    }


@dataclass(frozen=True, slots=True)
class RouterSettings:
    """The listening side.

    Args:
        robots: None to let anyone join.
        certificate, key: PEM files of the server.
        ca: PEM file of the authority that signed the certificates of robots.
    """

    listen: str
    robots: RobotCredentials | None = None
    certificate: str = ""
    key: str = ""
    ca: str = ""

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can connect."""
        return is_loopback_address(self.listen)

    def check(self, *, is_open: bool) -> None:
        """Refuse to listen to a network without TLS and credentials.

        Args:
            is_open: the user allowed explicitly that anyone may join and read.

        Raises:
            FleetAccessError: it is not safe.
        """
        if not self.is_loopback and not is_open and (self.robots is None or not self.listen.startswith("tls/")):
            missing = "a file of robots (--robots)" if self.robots is None else "TLS (tls/HOST:PORT)"
            raise FleetAccessError(
                f"{self.listen} can be reached by others: without {missing}, any of them could pose as a robot or read "
                "what robots send. Add it, or use --anyone-may-join-and-listen on a network that you trust"
            )
        if self.listen.startswith("tls/") and not (self.certificate and self.key):
            raise FleetAccessError("tls/ needs bus_certificate and bus_key: the PEM files of this server")
        if self.robots is not None and not self.robots.have_passwords and not self.ca:
            raise FleetAccessError("Robots without passwords show certificates: give bus_ca, which signed them")

    def settings(self) -> dict[str, Any]:
        robots = self.robots
        settings: Mapping[str, Any] = {
            **SETTINGS,
            "mode": "router",
            "listen/endpoints": [self.listen],
            "listen/exit_on_failure": True,
            "connect/endpoints": [],
            "transport/unicast/max_sessions": MAX_SESSIONS,
            "transport/unicast/accept_pending": 1000,
            "transport/link/tls/listen_certificate": self.certificate or None,
            "transport/link/tls/listen_private_key": self.key or None,
            "transport/link/tls/root_ca_certificate": self.ca or None,
            "transport/link/tls/enable_mtls": True if self.ca else None,
            "access_control": None if robots is None else access_rules(robots),
            "transport/auth/usrpwd/dictionary_file": (
                str(robots.path.absolute()) if robots is not None and robots.have_passwords else None
            ),
        }
        return {name: value for name, value in settings.items() if value is not None}


def as_document(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings as the configuration file of a router (`zenohd -c FILE`)."""
    document: dict[str, Any] = {}
    for name, value in settings.items():
        place = document
        *folders, last = name.split("/")
        for folder in folders:
            place = place.setdefault(folder, {})
        place[last] = value
    return document
