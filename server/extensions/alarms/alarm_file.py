"""Alarms in the data folder: definitions, and what has to survive a restart of their states.

    <data>/alarms.json    {"imuscope": 1, "alarms": [{"id", "definition"}], "states": {id: {device: {…}}}}

A device is named by its source, and its address on a shared link, because its id is new in every run. The file is
written completely or not at all (recordings/system/atomic_write.py). One that cannot be read is renamed, never
overwritten.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from imuscope.recordings.system import atomic_write
from imuscope.server.extensions.alarms.definitions import StoredAlarm
from imuscope.server.wire import DeviceInfo

FORMAT = 1
MAX_BYTES = 4 << 20
UNREADABLE = ".unreadable"


@dataclass(slots=True)
class AlarmFile:
    """Contents of the file.

    Attributes:
        states: AlarmMachine.saved by alarm and device.
        problem: why the file could not be read; "" if it was.
    """

    alarms: list[StoredAlarm] = field(default_factory=list)
    states: dict[str, dict[str, dict[str, Any]]] = field(default_factory=dict)
    problem: str = ""

    @classmethod
    def load(cls, path: Path) -> "AlarmFile":
        """Read the file; without one there are no alarms. Runs in a thread."""
        try:
            if path.stat().st_size > MAX_BYTES:
                raise ValueError("it is too large")
            body = json.loads(path.read_bytes())
            if not isinstance(body, dict) or body.get("imuscope") != FORMAT:
                raise ValueError("it is not a file of alarms of this version")
            alarms = [StoredAlarm.model_validate(one) for one in body.get("alarms", [])]
            states = {
                str(alarm): {str(device): dict(saved) for device, saved in dict(devices).items()}
                for alarm, devices in dict(body.get("states") or {}).items()
            }
        except FileNotFoundError:
            return cls()
        except (OSError, ValueError, TypeError, RecursionError) as error:
            reason = "its contents are invalid" if isinstance(error, ValidationError | TypeError) else str(error)
            return cls(problem=f"The alarms in {path.name} cannot be read: {reason:.200}.{cls._set_aside(path)}")
        return cls(alarms, states)

    @staticmethod
    def _set_aside(path: Path) -> str:
        try:
            atomic_write.replace(path, path.with_name(path.name + UNREADABLE))
        except OSError:
            return ""
        return f" The file is now {path.name}{UNREADABLE}."

    def save(self, path: Path) -> None:
        """Write the file. Runs in a thread.

        Raises:
            OSError: writing failed; the old file is unchanged.
        """
        body = {
            "imuscope": FORMAT,
            "alarms": [one.model_dump(mode="json") for one in self.alarms],
            "states": self.states,
        }
        atomic_write.write_atomic(path, json.dumps(body, ensure_ascii=False, indent=1, allow_nan=False))


def lasting_name(info: DeviceInfo) -> str:
    """Name of a device that is the same after a restart."""
    _, point, address = info.id.partition(".")
    return f"{info.source}#{address}" if point else info.source
