"""Workspaces of the page, stored by name, and the one that each family of devices opens with.

    <data>/workspaces/<letters of the name>-<8 hex digits>.json     {"name", "modified", "workspace"}
    <data>/workspaces/defaults.json                                 family → name

The server does not read what a workspace holds: the page checks every part of it (web/src/workspace/parts.ts). The
server checks the envelope, the size and the name. A stored workspace has a revision, and a write names the revision
that it replaces, so that of two people who edit one workspace neither loses work without a notice.
"""

import hashlib
import json
import logging
import re
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imuscope.recordings.system import atomic_write
from imuscope.recordings.system.regular_file import read_regular
from imuscope.server.errors import DomainError

log = logging.getLogger("imuscope.workspaces")

FOLDER = "workspaces"
DEFAULTS = "defaults.json"
FORMAT = "imuscope-workspace"
MAX_NAME = 80
MAX_BYTES = 256 * 1024
MAX_WORKSPACES = 200
MAX_FAMILY = 40
ANY = "*"
"""The revision of a write that replaces whatever is there."""


@dataclass(frozen=True, slots=True)
class StoredWorkspace:
    """A workspace as stored.

    Args:
        modified: unix s.
        revision: changes with every change of the content.
    """

    name: str
    modified: float
    revision: str
    workspace: dict[str, Any]


def clean_name(name: str) -> str:
    """The name with single spaces.

    Raises:
        DomainError: it is empty or too long, or has characters that cannot be shown.
    """
    text = " ".join(name.split())
    if not 1 <= len(text) <= MAX_NAME or not text.isprintable():
        hint = f"Use 1 to {MAX_NAME} printable characters."
        raise DomainError("bad-request", f"“{name:.100}” cannot be the name of a workspace.", hint)
    return text


class WorkspaceStore:
    """The workspaces of one data folder. Every method reads or writes files, and may be called by any thread."""

    def __init__(self, data: Path) -> None:
        self._folder = data / FOLDER
        self._lock = threading.Lock()

    def all(self) -> list[StoredWorkspace]:
        """By name; a damaged file is left out and logged."""
        workspaces = [self._read(path) for path in self._paths()]
        return sorted((one for one in workspaces if one is not None), key=lambda one: one.name.casefold())

    def get(self, name: str) -> StoredWorkspace:
        """The workspace of that name.

        Raises:
            DomainError: there is none, or the name is not valid.
        """
        workspace = self._read(self._path(clean_name(name)))
        if workspace is None:
            raise _unknown(name)
        return workspace

    def put(self, name: str, workspace: dict[str, Any], replaces: str | None) -> StoredWorkspace:
        """Store a workspace.

        Args:
            replaces: revision of the one that is replaced; None: there must be none of that name; ANY: any of them.

        Raises:
            DomainError: the name or the workspace is not valid, another client changed it, there are too many, or
                writing failed.
        """
        name = clean_name(name)
        _check(workspace)
        path = self._path(name)
        with self._lock:
            before = self._read(path)
            _check_revision(name, before, replaces)
            if before is None and len(self._paths()) >= MAX_WORKSPACES:
                raise DomainError("full", f"There are {MAX_WORKSPACES} workspaces, the most.", "Delete one first.")
            text = _text({"name": name, "modified": time.time(), "workspace": workspace})
            self._write(path, text)
            stored = self._read(path)
        assert stored is not None
        return stored

    def delete(self, name: str, revision: str = ANY) -> None:
        """Delete a workspace; families that opened with it open with the page's own layout.

        Raises:
            DomainError: there is none of that name, or another client changed it since `revision`.
        """
        name = clean_name(name)
        path = self._path(name)
        with self._lock:
            before = self._read(path)
            if before is None:
                raise _unknown(name)
            _check_revision(name, before, revision)
            atomic_write.remove(path)

    def defaults(self) -> dict[str, str]:
        """The workspace of each family that has one, by family."""
        try:
            content = json.loads((self._folder / DEFAULTS).read_text())
        except FileNotFoundError:
            return {}
        except (OSError, ValueError) as error:
            log.warning("%s cannot be read: %s", DEFAULTS, error)
            return {}
        names = {one.name for one in self.all()}
        chosen = content if isinstance(content, dict) else {}
        return {str(family): name for family, name in chosen.items() if name in names}

    def set_default(self, family: str, name: str | None) -> dict[str, str]:
        """Set or remove the workspace that a family opens with.

        Raises:
            DomainError: there is no such workspace, the family is not valid, or writing failed.
        """
        if not re.fullmatch(rf"[\w.-]{{1,{MAX_FAMILY}}}", family):
            raise DomainError(
                "bad-request",
                f"“{family:.80}” is not a protocol family.",
                "It is the protocol of a device, as in the list of devices.",
            )
        with self._lock:
            chosen = {key: value for key, value in self.defaults().items() if key != family}
            if name is not None:
                chosen[family] = self.get(name).name
            self._write(self._folder / DEFAULTS, _text(chosen))
        return chosen

    def _paths(self) -> list[Path]:
        return [path for path in self._folder.glob("[!.]*.json") if path.name != DEFAULTS]

    def _path(self, name: str) -> Path:
        letters = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:40]
        return self._folder / f"{letters}-{hashlib.sha256(name.encode()).hexdigest()[:8]}.json"

    def _read(self, path: Path) -> StoredWorkspace | None:
        try:
            content = read_regular(path)
            document = json.loads(content)
            name, modified, workspace = document["name"], float(document["modified"]), document["workspace"]
            _check(workspace)
            if clean_name(name) != name or self._path(name) != path:
                raise ValueError("its name is not the one of the file")
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError, DomainError) as error:
            log.warning("The workspace %s cannot be read: %s", path.name, error)
            return None
        return StoredWorkspace(name, modified, hashlib.sha256(content).hexdigest()[:16], workspace)

    def _write(self, path: Path, text: str) -> None:
        try:
            atomic_write.write_atomic(path, text)
        except OSError as error:
            message = f"The workspace could not be stored: {error.strerror or error}."
            raise DomainError("disk", message, "Free some space, or check the rights of the data folder.") from None


def _check(workspace: Any) -> None:
    """Raise DomainError if this cannot be a workspace, or is too large."""
    is_workspace = (
        isinstance(workspace, dict)
        and workspace.get("format") == FORMAT
        and isinstance(workspace.get("version"), int)
        and isinstance(workspace.get("parts"), dict)
    )
    if not is_workspace:
        hint = f"It has the format “{FORMAT}”, a version, and parts."
        raise DomainError("bad-request", "This is not a workspace of imuscope.", hint)
    size = len(_text(workspace).encode())
    if size > MAX_BYTES:
        message = f"The workspace has {size // 1024} kB; at most {MAX_BYTES // 1024} kB can be stored."
        raise DomainError("too-large", message, "Shorten its notes.")


def _text(value: Any) -> str:
    """JSON that can be read by anything.

    Raises:
        DomainError: a number is not finite, a text cannot be encoded, or it is nested too deeply.
    """
    try:
        text = json.dumps(value, ensure_ascii=False, allow_nan=False, indent=1)
        text.encode()
    except (ValueError, RecursionError):  # UnicodeEncodeError is a ValueError
        message = "The workspace has a number or a text that JSON cannot hold."
        raise DomainError("bad-request", message, "Numbers are finite, and texts are valid Unicode.") from None
    return text


def _check_revision(name: str, before: StoredWorkspace | None, replaces: str | None) -> None:
    if replaces == ANY or (before is None and replaces is None):
        return
    if before is None:
        hint = "Save it under a name to store it again."
        raise DomainError("changed", f"The workspace {name} was deleted since it was opened.", hint)
    if replaces is None:
        hint = "Open it first, or choose another name."
        raise DomainError("name", f"There is a workspace {name} already.", hint)
    if replaces != before.revision:
        hint = "Open the newer one, or save yours under another name."
        raise DomainError("changed", f"The workspace {name} was changed since it was opened.", hint)


def _unknown(name: str) -> DomainError:
    return DomainError(
        "not-found", f"Workspace {name:.80} not found.", "It may have been deleted; choose one of the list."
    )
