"""The topics of ROS 2 that are switched off, stored in the data folder.

    ros2.json    {"switched_off": ["1 imu/mag", "2 /diagnostics"]}        id of the device, its topic

The file is replaced atomically; unreadable parts count as absent, so that every topic is published.
"""

from __future__ import annotations

import json
from pathlib import Path

from imuscope.recordings.system import atomic_write
from imuscope.server.errors import DomainError

FILE = "ros2.json"
MAX_TOPICS = 10_000  # names of devices that are gone stay, and are bounded


class TopicSwitches:
    """The topics that are switched off, by their keys.

    Args:
        folder: the data folder.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE
        self._off = self._read()

    @property
    def off(self) -> frozenset[str]:
        return self._off

    def set(self, topic: str, *, enabled: bool) -> None:
        """Remember whether a topic is published.

        Raises:
            DomainError: "full" or "disk"; nothing has changed then.
        """
        off = self._off - {topic} if enabled else self._off | {topic}
        if len(off) > MAX_TOPICS:
            raise DomainError("full", f"{MAX_TOPICS} topics are switched off.", "Switch one on first.")
        if off == self._off:
            return
        try:
            self._write(off)
        except OSError as error:
            message = f"The switch cannot be stored: {error.strerror or error}."
            raise DomainError("disk", message, "Free some space, or check the rights of the data folder.") from None
        self._off = off

    def _write(self, off: frozenset[str]) -> None:
        atomic_write.write_atomic(self._path, json.dumps({"switched_off": sorted(off)}, indent=1))

    def _read(self) -> frozenset[str]:
        try:
            content = json.loads(self._path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return frozenset()
        rows = content.get("switched_off") if isinstance(content, dict) else None
        return frozenset(row for row in rows if isinstance(row, str)) if isinstance(rows, list) else frozenset()
