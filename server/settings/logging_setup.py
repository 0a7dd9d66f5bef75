"""Logging to standard error, one line per event.

    text         2026-11-21 08:31:02.114Z warning [1] /dev/ttyUSB0 is gone. Was it unplugged? …
    journal      the same without the time, which the journal adds, and with systemd's level prefix: <4>[1] …
    json         {"time":"2026-11-21T08:31:02.114Z","level":"warning","event":"link","device":"1","message":"…",…}

Events are logged by server/streaming/event_logging.py and by the modules in which they occur, through `logging` under
the name imuscope; `extra` carries `event` (one word for programs), `device`, and `data` (further values).

Two guarantees hold for every line. It contains no secret (token, key): each occurrence is replaced. And input can
neither forge lines nor fill the disk: characters that are not printable are escaped, and of frequent messages
(`extra={"often": key}`) a few lines are written per ten seconds; the next line says how many were omitted.
"""

import json
import logging
import os
import sys
import time
from collections.abc import Collection, Mapping
from typing import Any, TextIO

from imuscope.server.concurrency.limiters import PeriodLimit
from imuscope.server.text.printable import json_text, printable

STYLES = ("text", "json")
LEVELS = ("debug", "info", "warning", "error")
PERIOD_S = 10.0
PER_PERIOD = 5
MIN_SECRET_CHARS = 8  # characters of a secret
_MAX_KEYS = 256
_PRIORITY = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3, logging.CRITICAL: 2}
_OURS = ("imuscope",)


class RateLimitFilter(logging.Filter):
    """Limits the records of one key per period; the next record carries the number of suppressed ones."""

    def __init__(self, now: Any = time.monotonic) -> None:
        super().__init__()
        self._now = now
        self._counts: dict[Any, PeriodLimit] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        key = getattr(record, "often", None)
        if key is None:
            return True
        now = self._now()
        if key not in self._counts and len(self._counts) >= _MAX_KEYS:
            self._counts = {one: limit for one, limit in self._counts.items() if now - limit.began < PERIOD_S}
            if len(self._counts) >= _MAX_KEYS:
                self._counts.clear()
        limit = self._counts.setdefault(key, PeriodLimit(PER_PERIOD, PERIOD_S))
        record.held = limit.begin(now)
        return limit.allows()


class _Formatter(logging.Formatter):
    """Behaviour shared by both formats: secrets are removed from the finished line."""

    def __init__(self, secrets: Collection[str]) -> None:
        super().__init__()
        forms = {form for secret in secrets if secret for form in (secret, json.dumps(secret)[1:-1])}
        self._secrets = sorted(forms, key=len, reverse=True)

    def format(self, record: logging.LogRecord) -> str:
        line = self.line(record)
        for secret in self._secrets:
            line = line.replace(secret, "…")
        return line

    def line(self, record: logging.LogRecord) -> str:
        raise NotImplementedError


class TextFormatter(_Formatter):
    """Text for reading; with `journal`, in the format of systemd's journal."""

    def __init__(self, secrets: Collection[str], *, journal: bool = False) -> None:
        super().__init__(secrets)
        self._for_journal = journal

    def line(self, record: logging.LogRecord) -> str:
        device = getattr(record, "device", "")
        text = f"[{device}] " if device else ""
        text += printable(record.getMessage())
        suppressed = getattr(record, "held", 0)
        if suppressed:
            text += f" ({suppressed} more like this were not written.)"
        if record.exc_info:
            text += "\n" + self.formatException(record.exc_info)
        if self._for_journal:
            return f"<{_PRIORITY.get(record.levelno, 5)}>{text}"
        clock = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(record.created))
        return f"{clock}.{int(record.msecs):03d}Z {record.levelname.lower():<7} {text}"


class JsonFormatter(_Formatter):
    """JSON for programs: one object per line."""

    def line(self, record: logging.LogRecord) -> str:
        clock = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
        fields: dict[str, Any] = {
            "time": f"{clock}.{int(record.msecs):03d}Z",
            "level": record.levelname.lower(),
            "event": getattr(record, "event", "") or record.name.rpartition(".")[2],
            "device": getattr(record, "device", ""),
            "message": record.getMessage(),
        }
        data = getattr(record, "data", None)
        if isinstance(data, Mapping):
            fields.update({name: value for name, value in data.items() if name not in fields})
        if suppressed := getattr(record, "held", 0):
            fields["held"] = suppressed
        if record.exc_info:
            fields["exception"] = self.formatException(record.exc_info)
        return json_text(fields, default=str, separators=(",", ":"))


def install(style: str, level: str, secrets: Collection[str] = ()) -> None:
    """Configure logging.

    Args:
        style: one of STYLES.
        level: one of LEVELS: lowest level of our messages. Libraries log warnings only, as some log headers at "debug".
        secrets: texts that must not appear in the log.
    """
    handler = logging.StreamHandler(sys.stderr)
    text = TextFormatter(secrets, journal=_is_journal(sys.stderr))
    handler.setFormatter(JsonFormatter(secrets) if style == "json" else text)
    handler.addFilter(RateLimitFilter())
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(logging.WARNING)
    for name in _OURS:
        logging.getLogger(name).setLevel(level.upper())


def secrets_of(*texts: str) -> list[str]:
    """Secrets that are long enough to be masked; a short one would match parts of every line."""
    return [one for one in texts if len(one) >= MIN_SECRET_CHARS and not one.startswith("@")]


def print_or_log(text: str) -> None:
    """Print a message of the command line itself: as plain text, or as a log line if the log is JSON."""
    handlers = logging.getLogger().handlers
    if handlers and isinstance(handlers[0].formatter, JsonFormatter):
        logging.getLogger("imuscope.start").info("%s", text)
    else:
        print(text, file=sys.stderr, flush=True)


def _is_journal(out: TextIO) -> bool:
    """Whether the stream goes to systemd's journal: JOURNAL_STREAM gives the device and inode of its file."""
    try:
        status = os.fstat(out.fileno())
    except (OSError, ValueError):
        return False
    return os.environ.get("JOURNAL_STREAM", "") == f"{status.st_dev}:{status.st_ino}"
