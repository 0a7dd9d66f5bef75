"""The last verified sequence numbers of Secure devices, kept in the data folder.

    secure-sequences.json    {"<fingerprint of the key>": {"<device id>": [number, unix seconds]}}

A frame that was captured yesterday must not count today because the server was started anew in between. So the numbers
are written every few seconds while they change, and when the server ends; what arrived in the last seconds before a
power cut can be replayed, nothing older. A key is kept as a keyed hash of it, never itself. The file is written aside
and renamed; one that cannot be read counts as empty. At most `MOST` devices are kept, the latest.

Only real links count here: a recording that is played again is meant to be heard again.
"""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import json
import logging
import threading
import time
from collections.abc import Mapping
from pathlib import Path

from recordings import atomic_write

log = logging.getLogger("imuscope.sequences")

FILE = "secure-sequences.json"
MOST = 4096
EVERY_S = 5.0
_HALF, _MASK = 1 << 31, (1 << 32) - 1

Numbers = dict[str, dict[str, tuple[int, float]]]


def fingerprint(key: bytes) -> str:
    """What stands for a key in the file."""
    return hmac.new(key, b"imuscope sequence numbers", hashlib.sha256).hexdigest()[:16]


def check_format_version(number: int, than: int) -> bool:
    """Does `number` follow `than`, modulo 2^32?"""
    return 0 < (number - than) & _MASK < _HALF


class SequenceStore:
    """The file.

    Args:
        folder: the data folder; None keeps nothing beyond this process.
    """

    def __init__(self, folder: Path | None) -> None:
        self._path = folder / FILE if folder is not None else None
        self._lock = threading.Lock()
        self._known = self._read()
        self._new: dict[tuple[str, str], tuple[int, float]] = {}

    def recall(self, key: bytes) -> dict[int, int]:
        """The last number of every device with this key."""
        with self._lock:
            return {int(device): number for device, (number, _) in self._known.get(fingerprint(key), {}).items()}

    def note(self, key: bytes, numbers: Mapping[int, int]) -> None:
        """Numbers that were verified by now. Written with the next `save`."""
        mark = fingerprint(key)
        with self._lock:
            known = self._known.setdefault(mark, {})
            for device, number in numbers.items():
                old = known.get(str(device))
                if old is None or check_format_version(number, old[0]):
                    known[str(device)] = self._new[mark, str(device)] = (number, round(time.time(), 1))

    def forget(self, key: bytes | None = None, device: int | None = None) -> int:
        """Forget a device (None: all) of a key (None: whichever), at once and in the file; how many were forgotten.

        Raises:
            OSError: the file cannot be written.
        """
        mark = fingerprint(key) if key is not None else None
        with self._lock:
            self._merge()
            gone = [
                (one, name)
                for one, devices in self._known.items()
                for name in devices
                if mark in (None, one) and device in (None, int(name))
            ]
            for one, name in gone:
                del self._known[one][name]
                self._new.pop((one, name), None)
            if gone:
                self._write()
            return len(gone)

    def save(self) -> None:
        """Write what is new. A disk that refuses is told once a time and changes nothing else."""
        with self._lock:
            if not self._new:
                return
            try:
                self._merge()
                self._write()
            except OSError as error:
                log.warning("The sequence numbers of Secure devices cannot be kept: %s.", error.strerror or error)

    def _merge(self) -> None:
        """Take over what another process wrote; what is new here counts where it is newer."""
        known = self._read()
        for (mark, device), (number, seen) in self._new.items():
            there = known.setdefault(mark, {}).get(device)
            if there is None or check_format_version(number, there[0]):
                known[mark][device] = (number, seen)
        self._known = known if self._path is not None else self._known

    def _write(self) -> None:
        kept = sorted(((seen, mark, one) for mark, all_ in self._known.items() for one, (_, seen) in all_.items()))
        for _, mark, one in kept[:-MOST]:
            del self._known[mark][one]
        if self._path is not None:
            atomic_write.write_atomic(
                self._path, json.dumps({mark: all_ for mark, all_ in self._known.items() if all_})
            )
        self._new.clear()

    def _read(self) -> Numbers:
        if self._path is None:
            return {}
        try:
            told = json.loads(self._path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return {}
        found: Numbers = {}
        for mark, devices in told.items() if isinstance(told, dict) else ():
            for device, row in devices.items() if isinstance(devices, dict) else ():
                with contextlib.suppress(TypeError, ValueError, IndexError, KeyError, OverflowError):
                    number, seen, sender = int(row[0]), float(row[1]), int(device)
                    if 0 <= number <= _MASK and 0 <= sender <= 0xFFFF:
                        found.setdefault(str(mark), {})[str(sender)] = (number, seen)
        return found
