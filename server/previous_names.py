"""Names of the previous version, which are still accepted.

They occur in recordings, rollback records, settings files, saved addresses and scripts. Each is translated on input, so
that all other code uses one name; HTTP answers have previous keys beside the current ones. The tables may be emptied
one version later.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Receive, Scope, Send

SETTINGS = {"trial_s": "rollback_s"}
"""Settings of the configuration file and of the environment."""

SCHEMES = {"twin": "sim"}
"""Schemes of sources."""

LINKS = {"twin": "simulator"}
"""Kinds of links, in the metadata of recordings."""

LEVELS = {"caution": "warning", "fault": "error"}
"""Levels of events, in recordings."""

ROLLBACK_STATES = {"asking": "pending", "reverting": "rolling-back"}
"""States of rollback records on disk."""

_KEYS = (
    {"required_action": "wants"},  # of a device
    {"requested": "asked", "actual": "got", "reason": "why"},  # of a field that a device did not accept
    {"direction": "way"},  # of a frame
)
"""Keys of objects in HTTP answers: those that have all current keys of a row."""

_PATHS = tuple(
    (re.compile(rf"(/api/{old})\Z"), new)
    for old, new in (
        (r"recordings/[^/]+/fared", "health"),
        (r"devices/[^/]+/control", "jobs"),
        (r"devices/[^/]+/exchange", "traffic"),
        (r"devices/[^/]+/reading", "decode-options"),
        (r"devices/[^/]+/fit", "fit-rates"),
        (r"devices/[^/]+/keep", "confirm"),
        (r"devices/[^/]+/revert", "roll-back"),
    )
)


def path_of(path: str) -> str:
    """The current path for a path of the HTTP API."""
    for old, new in _PATHS:
        if old.match(path):
            return f"{path.rpartition('/')[0]}/{new}"
    return path


def with_previous_keys(value: Any) -> Any:
    """A JSON value whose objects have their previous keys too."""
    if isinstance(value, list):
        return [with_previous_keys(one) for one in value]
    if not isinstance(value, dict):
        return value
    renamed = {key: with_previous_keys(one) for key, one in value.items()}
    for row in _KEYS:
        if row.keys() <= renamed.keys():
            renamed |= {old: renamed[new] for new, old in row.items()}
    return renamed


def rename_folder(old: Path, new: Path) -> None:
    """Rename a data folder, if only the old one exists.

    Raises:
        OSError: it cannot be renamed.
    """
    if old.is_dir() and not new.exists():
        old.rename(new)


class PreviousPaths:
    """ASGI middleware: a request for a path of the previous version is served by the current route."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and (path := path_of(scope["path"])) != scope["path"]:
            scope = {**scope, "path": path, "raw_path": path.encode()}
        await self._app(scope, receive, send)
