"""What does a server say on standard error, and to whom? One line for each thing that happens.

    a person     2026-11-21 08:31:02.114 warning [1] /dev/ttyUSB0 is gone. Was it unplugged? …
    a journal    the same without the time, which the journal has, and with systemd's mark of the level: <4>[1] …
    a program    {"time":"2026-11-21T08:31:02.114Z","level":"warning","event":"link","device":"1","message":"…",…}

What happens is told by server/streaming/event_logging.py and by the modules it happens in, through `logging` under the
name imuscope; `extra` carries `event` (one word for programs), `device`, and `data` (further figures).

Two promises are kept here, whoever writes the line. A secret (token, key) never gets into it: each is replaced wherever
it stands. And nobody can forge a line or fill a disk with many: characters that are not printable are spelled, and of
what may come often (`extra={"often": key}`) a few lines in ten seconds are written; the next tells how many were not.
"""

from __future__ import annotations

import json
import logging
import os
import sys
import time
from collections.abc import Collection, Mapping
from typing import Any, TextIO

from server.printable import json_text, printable

STYLES = ("text", "json")
LEVELS = ("debug", "info", "warning", "error")
PERIOD_S = 10.0
PER_PERIOD = 5
SHORTEST = 8  # characters of a secret
_MOST_KEYS = 256
_PRIORITY = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3, logging.CRITICAL: 2}
_OURS = ("imuscope", "server")


class RateLimitFilter(logging.Filter):
    """Lets only so many records of one key through in a while; the next one carries how many were held back."""

    def __init__(self, now: Any = time.monotonic) -> None:
        super().__init__()
        self._now = now
        self._known: dict[Any, list[float]] = {}  # key → when its period began, how many came in it

    def filter(self, record: logging.LogRecord) -> bool:
        key = getattr(record, "often", None)
        if key is None:
            return True
        now = self._now()
        known = self._known.get(key)
        if known is None or now - known[0] >= PERIOD_S:
            record.held = int(max(0.0, known[1] - PER_PERIOD)) if known is not None else 0
            if len(self._known) >= _MOST_KEYS:
                self._known = {one: kept for one, kept in self._known.items() if now - kept[0] < PERIOD_S}
            if len(self._known) >= _MOST_KEYS:
                self._known.clear()
            known = self._known[key] = [now, 0]
        known[1] += 1
        return known[1] <= PER_PERIOD


class _Formatter(logging.Formatter):
    """What both forms share: secrets are taken out of whatever was made."""

    def __init__(self, secrets: Collection[str]) -> None:
        super().__init__()
        spelled = {form for secret in secrets if secret for form in (secret, json.dumps(secret)[1:-1])}
        self._secrets = sorted(spelled, key=len, reverse=True)

    def format(self, record: logging.LogRecord) -> str:
        line = self.line(record)
        for secret in self._secrets:
            line = line.replace(secret, "…")
        return line

    def line(self, record: logging.LogRecord) -> str:
        raise NotImplementedError


class TextFormatter(_Formatter):
    """For a person; with `journal` for systemd's."""

    def __init__(self, secrets: Collection[str], *, journal: bool = False) -> None:
        super().__init__(secrets)
        self._journal = journal

    def line(self, record: logging.LogRecord) -> str:
        device = getattr(record, "device", "")
        text = f"[{device}] " if device else ""
        text += printable(record.getMessage())
        held = getattr(record, "held", 0)
        if held:
            text += f" ({held} more like this were not written.)"
        if record.exc_info:
            text += "\n" + self.formatException(record.exc_info)
        if self._journal:
            return f"<{_PRIORITY.get(record.levelno, 5)}>{text}"
        clock = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(record.created))
        return f"{clock}.{int(record.msecs):03d} {record.levelname.lower():<7} {text}"


class JsonFormatter(_Formatter):
    """For a program: one object a line."""

    def line(self, record: logging.LogRecord) -> str:
        clock = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
        told: dict[str, Any] = {
            "time": f"{clock}.{int(record.msecs):03d}Z",
            "level": record.levelname.lower(),
            "event": getattr(record, "event", "") or record.name.rpartition(".")[2],
            "device": getattr(record, "device", ""),
            "message": record.getMessage(),
        }
        data = getattr(record, "data", None)
        if isinstance(data, Mapping):
            told.update({name: value for name, value in data.items() if name not in told})
        if held := getattr(record, "held", 0):
            told["held"] = held
        if record.exc_info:
            told["exception"] = self.formatException(record.exc_info)
        return json_text(told, default=str, separators=(",", ":"))


def install(style: str, level: str, secrets: Collection[str] = (), out: TextIO | None = None) -> None:
    """From here on the log is like that.

    Args:
        style: one of STYLES.
        level: one of LEVELS: the least that is written of ours. Of libraries, warnings: at "debug" some write headers.
        secrets: what must never be in it.
        out: standard error, where nothing is given.
    """
    out = out or sys.stderr
    handler = logging.StreamHandler(out)
    text = TextFormatter(secrets, journal=_is_journal(out))
    handler.setFormatter(JsonFormatter(secrets) if style == "json" else text)
    handler.addFilter(RateLimitFilter())
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(logging.WARNING)
    for name in _OURS:
        logging.getLogger(name).setLevel(level.upper())


def secrets_of(*given: str) -> list[str]:
    """Those of these that are long enough to be secrets: two digits stand in every line."""
    return [one for one in given if len(one) >= SHORTEST and not one.startswith("@")]


def print_or_log(text: str) -> None:
    """A sentence of the command line itself, before and beside what happens: as it is to a person, as a line of the
    log to a program."""
    handlers = logging.getLogger().handlers
    if handlers and isinstance(handlers[0].formatter, JsonFormatter):
        logging.getLogger("imuscope.start").info("%s", text)
    else:
        print(text, file=sys.stderr, flush=True)


def _is_journal(out: TextIO) -> bool:
    """Does systemd's journal read this? It says of which file it does."""
    try:
        about = os.fstat(out.fileno())
    except (OSError, ValueError):
        return False
    return os.environ.get("JOURNAL_STREAM", "") == f"{about.st_dev}:{about.st_ino}"
