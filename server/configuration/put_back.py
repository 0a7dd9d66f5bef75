"""Frames that put devices back into the state in which they were found, stored while a transaction is under way.

    <data>/put-back/<source>.json      written before a transaction changes the state of a device, removed when it ends

A server that is killed in between finds the file when it starts again and sends the frames: an MTi measures again, the
streams of an IMX run again. Settings that were being written are rolled back by server/configuration/rollback.py.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import logging
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from imuscope.recordings import atomic_write
from imuscope.recordings.regular_file import read_regular
from imuscope.server.configuration.device_controller import DeviceController, QueuedJob
from imuscope.server.configuration.timings import ConfigurationTimings
from imuscope.server.links.base import LinkError

log = logging.getLogger("imuscope.put_back")

TITLE = "Put the device back into its state"


@dataclass(frozen=True, slots=True)
class Interrupted:
    """A transaction that did not end.

    Args:
        device: name of the device on its link; "" for the first.
        frames: as hex.
    """

    source: str
    device: str
    frames: tuple[str, ...]


class PutBackStore:
    """The folder. It is used by threads."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def keep(self, source: str, device: str, frames: Sequence[bytes]) -> None:
        """Store the frames of a device; none: remove what is stored. A write error is logged: reading goes on."""
        path = self._path(source, device)
        try:
            if not frames:
                if path.exists():
                    atomic_write.remove(path)
                return
            self._folder.mkdir(parents=True, exist_ok=True)
            body = {"source": source, "device": device, "frames": [frame.hex() for frame in frames]}
            atomic_write.write_atomic(path, json.dumps(body))
        except OSError as error:
            log.warning("%s: %s", path, error.strerror or error)

    def all(self) -> list[Interrupted]:
        """Transactions that the previous run left; a file that cannot be read is logged and removed."""
        found = []
        for path in sorted(self._folder.glob("*.json")) if self._folder.is_dir() else []:
            try:
                body = json.loads(read_regular(path))
                frames = tuple(bytes.fromhex(frame).hex() for frame in body["frames"])
                found.append(Interrupted(str(body["source"]), str(body["device"]), frames))
            except (OSError, KeyError, ValueError, TypeError, RecursionError) as error:
                log.warning("%s cannot be read: %s", path, error)
                atomic_write.remove(path)
        return found

    def _path(self, source: str, device: str) -> Path:
        return self._folder / f"{hashlib.sha256(f'{source}#{device}'.encode()).hexdigest()[:16]}.json"


def putting_back(
    controller: DeviceController, store: PutBackStore, found: Interrupted, timings: ConfigurationTimings
) -> Callable[[QueuedJob], Awaitable[None]]:
    """Job that sends the frames once the link is open."""

    async def work(task: QueuedJob) -> None:
        waited = 0.0
        while not controller.session.info.is_open and waited < timings.port_back_s:
            await asyncio.sleep(timings.port_look_s)
            waited += timings.port_look_s
        try:
            for frame in found.frames:
                data = bytes.fromhex(frame)
                controller.log.sent(data, "")
                await controller.session.send(data)
        except LinkError as error:
            if error.kind != "busy":
                raise  # stays stored for the next start
            controller.log.add_note(f"{error.message} It is left to that program.")
        await asyncio.to_thread(store.keep, found.source, found.device, ())
        task.job.message = "A read or a write was interrupted when the server ended; the device is back in its state."

    return work
