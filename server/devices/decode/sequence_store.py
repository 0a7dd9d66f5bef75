"""The last verified sequence numbers of Secure devices, stored in the data folder.

    secure-sequences.json    {"<fingerprint of the key>": {"<device id>": [number, unix seconds]}}

A frame that was captured earlier must not be accepted again after a restart of the server. So the numbers are written
every few seconds while they change, and when the server ends; frames of the last seconds before a power cut can be
replayed, but no older ones. Keys are stored as keyed hashes only. The file is replaced atomically; an unreadable file
counts as empty. At most `MAX_DEVICES` devices are stored, the latest.

Only real links are tracked: playing a recording again is not an attack.
"""

import contextlib
import hashlib
import hmac
import json
import logging
import threading
import time
from collections.abc import Mapping
from pathlib import Path

from imuscope.recordings.system import atomic_write
from imuscope.recordings.system.regular_file import read_object

log = logging.getLogger("imuscope.sequences")

FILE = "secure-sequences.json"
MAX_DEVICES = 4096
EVERY_S = 5.0
_HALF, _MASK = 1 << 31, (1 << 32) - 1

Numbers = dict[str, dict[str, tuple[int, float]]]


def fingerprint(key: bytes) -> str:
    """Fingerprint of a key in the file."""
    return hmac.new(key, b"imuscope sequence numbers", hashlib.sha256).hexdigest()[:16]


def is_newer(number: int, than: int) -> bool:
    """Whether `number` follows `than`, modulo 2^32."""
    return 0 < (number - than) & _MASK < _HALF


class SequenceStore:
    """The file.

    Args:
        folder: the data folder; None to store nothing beyond this process.
    """

    def __init__(self, folder: Path | None) -> None:
        self._path = folder / FILE if folder is not None else None
        self._lock = threading.Lock()
        self._states = self._read()
        self._new: dict[tuple[str, str], tuple[int, float]] = {}

    def restore(self, key: bytes) -> dict[int, int]:
        """The last number of every device with this key."""
        with self._lock:
            return {int(device): number for device, (number, _) in self._states.get(fingerprint(key), {}).items()}

    def update(self, key: bytes, numbers: Mapping[int, int]) -> None:
        """Update verified numbers; they are written with the next `save`."""
        key_mark = fingerprint(key)
        with self._lock:
            known = self._states.setdefault(key_mark, {})
            for device, number in numbers.items():
                old = known.get(str(device))
                if old is None or is_newer(number, old[0]):
                    known[str(device)] = self._new[key_mark, str(device)] = (number, round(time.time(), 1))

    def forget(self, key: bytes | None = None, device: int | None = None) -> int:
        """Delete a device (None: all) of a key (None: any), also in the file; returns the number deleted.

        Raises:
            OSError: the file cannot be written.
        """
        key_mark = fingerprint(key) if key is not None else None
        with self._lock:
            self._merge()
            gone = [
                (one, name)
                for one, devices in self._states.items()
                for name in devices
                if key_mark in (None, one) and device in (None, int(name))
            ]
            for one, name in gone:
                del self._states[one][name]
                self._new.pop((one, name), None)
            if gone:
                self._write()
            return len(gone)

    def save(self) -> None:
        """Write new numbers. A write error is only logged."""
        with self._lock:
            if not self._new:
                return
            try:
                self._merge()
                self._write()
            except OSError as error:
                log.warning("The sequence numbers of Secure devices cannot be stored: %s.", error.strerror or error)

    def _merge(self) -> None:
        """Merge numbers that another process wrote; the newer number wins."""
        known = self._read()
        for (key_mark, device), (number, stamp) in self._new.items():
            stored = known.setdefault(key_mark, {}).get(device)
            if stored is None or is_newer(number, stored[0]):
                known[key_mark][device] = (number, stamp)
        self._states = known if self._path is not None else self._states

    def _write(self) -> None:
        entries = sorted(
            ((stamp, key_mark, one) for key_mark, all_ in self._states.items() for one, (_, stamp) in all_.items())
        )
        for _, key_mark, one in entries[:-MAX_DEVICES]:
            del self._states[key_mark][one]
        if self._path is not None:
            atomic_write.write_atomic(
                self._path, json.dumps({key_mark: all_ for key_mark, all_ in self._states.items() if all_})
            )
        self._new.clear()

    def _read(self) -> Numbers:
        numbers: Numbers = {}
        for key_mark, devices in read_object(self._path).items() if self._path is not None else ():
            for device, row in devices.items() if isinstance(devices, dict) else ():
                with contextlib.suppress(TypeError, ValueError, IndexError, KeyError, OverflowError):
                    number, stamp, sender = int(row[0]), float(row[1]), int(device)
                    if 0 <= number <= _MASK and 0 <= sender <= 0xFFFF:
                        numbers.setdefault(str(key_mark), {})[str(sender)] = (number, stamp)
        return numbers
