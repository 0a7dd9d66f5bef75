"""Operators of a fleet: users whose token sees all robots and commands those of some groups.

A line of their file has a name, a token and groups. The file is read again when it changes, so that a token is revoked
by removing its line; one that cannot be read any more gives no rights to anybody.

    ada:a-token-of-20-characters-or-more:otters,foxes
"""

import hmac
import logging
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.model.access import FleetAccessError

MAX_BY = 60  # characters


def operator_name(by: str) -> str:
    """The name of a user in one line.

    Raises:
        DomainError: it is missing or too long.
    """
    name = " ".join(by.split())
    if not name or len(name) > MAX_BY or not name.isprintable():
        raise DomainError("bad-value", "by: give the name of the person who does this.", f"Up to {MAX_BY} characters.")
    return name


log = logging.getLogger("imuscope.fleet")

MIN_TOKEN = 20  # characters, as of the tokens of the page
OF_ROBOT = re.compile(r"/(?:robots|api/fleet/robots)/([^/]+)(?:/|\Z)")
OF_ROLLOUT = re.compile(r"/api/fleet/rollouts/(\d{1,12})/")

GroupOf = Callable[[str], str | None]
"""The group of the robot with this name; None if there is none."""


@dataclass(frozen=True, slots=True)
class Operator:
    """A line of the file."""

    name: str
    token: str
    groups: frozenset[str]


def read_operators(path: Path) -> list[Operator]:
    """The operators of a file.

    Raises:
        FleetAccessError: it cannot be read, or a line is not valid.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise FleetAccessError(f"The file of operators {str(path)!r} cannot be read: {error}.") from None
    operators: list[Operator] = []
    for number, line in enumerate(lines, 1):
        if line.strip():
            try:
                operators.append(_operator(line, operators))
            except ValueError as error:
                raise FleetAccessError(f"Line {number} of {path}: {error}.") from None
    return operators


def _operator(line: str, before: list[Operator]) -> Operator:
    parts = line.split(":", 2)
    if len(parts) != 3:
        raise ValueError("give NAME:TOKEN:GROUP,GROUP")
    name, token, groups = " ".join(parts[0].split()), parts[1].strip(), [one.strip() for one in parts[2].split(",")]
    if not name or len(name) > 60 or not name.isprintable():
        raise ValueError("the name is missing, longer than 60 characters or not printable")
    if len(token) < MIN_TOKEN:
        raise ValueError(f"the token of {name} is too short; give it {MIN_TOKEN} characters or more")
    if not all(groups):
        raise ValueError(f"a group of {name} has no name")
    if any(name == one.name or token == one.token for one in before):
        raise ValueError(f"the name or the token of {name} is listed twice")
    return Operator(name, token, frozenset(groups))


class Operators:
    """Rights of operators (server/access/auth.py: PartialRights).

    Args:
        robot, rollout: the group of a robot, and that of a rollout.

    Raises:
        FleetAccessError: as of `read_operators`.
    """

    def __init__(self, path: Path, robot: GroupOf, rollout: GroupOf) -> None:
        self._path = path
        self._group_of = {OF_ROBOT: robot, OF_ROLLOUT: rollout}
        self._version = self._stamp()
        self._all = read_operators(path)

    def holder(self, token: str) -> str:
        """The name of the operator with this token; empty if there is none."""
        operator = self._of(token)
        return operator.name if operator is not None else ""

    def may_command(self, token: str, path: str) -> bool:
        """Whether the operator may command what a path names: a robot, or a rollout, of one of their groups."""
        operator = self._of(token)
        if operator is None:
            return False
        for pattern, group_of in self._group_of.items():
            match = pattern.match(path)
            if match:
                return group_of(match[1]) in operator.groups
        return False

    def _of(self, token: str) -> Operator | None:
        self._refresh()
        token_bytes, operator = token.encode(), None
        for one in self._all:
            if hmac.compare_digest(token_bytes, one.token.encode()):
                operator = one
        return operator

    def _stamp(self) -> object:
        try:
            state = self._path.stat()
        except OSError:
            return None
        return state.st_mtime_ns, state.st_size, state.st_ino

    def _refresh(self) -> None:
        version = self._stamp()
        if version == self._version:
            return
        self._version = version
        try:
            self._all = read_operators(self._path)
        except FleetAccessError as error:
            self._all = []
            log.error("No operator has rights until this is mended: %s", error)
