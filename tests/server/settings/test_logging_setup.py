"""The log: one line per event, without secrets, floods or forged lines."""

from __future__ import annotations

import io
import json
import logging
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.typing import Subprotocol

from imuscope.server.links.base import LinkError
from imuscope.server.settings import logging_setup
from imuscope.server.settings.config import Config, ConfigError, load
from imuscope.server.wire import SUBPROTOCOL
from tests.support.each_row import each_row
from tests.support.fakes import FakeLinks, sample
from tests.support.in_process_server import InProcessServer
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, connect, get
from tests.support.waiting import block_until

CONTROL = "c" * 12 + '"\\'
links = FakeLinks()


class Log:
    """Log output during a test, as a program would read it."""

    def __init__(self, out: io.StringIO) -> None:
        self._out = out

    @property
    def text(self) -> str:
        return self._out.getvalue()

    @property
    def lines(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.text.splitlines()]

    def until(self, done: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        results: list[dict[str, Any]] = block_until(lambda: [one for one in self.lines if done(one)], lambda: self.text)
        return results[0]


@pytest.fixture
def log() -> Iterator[Log]:
    out = io.StringIO()
    handler = logging.StreamHandler(out)
    handler.setFormatter(logging_setup.JsonFormatter([CONTROL]))
    handler.addFilter(logging_setup.RateLimitFilter())
    logger = logging.getLogger("imuscope")
    before = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    yield Log(out)
    logger.removeHandler(handler)
    logger.setLevel(before)


def test_device_events_are_logged(log: Log, tmp_path: Path) -> None:
    with InProcessServer(Config(sources=("/dev/one",), protocol="fake", data=tmp_path), links.open) as running:
        log.until(lambda line: line["event"] == "device" and line["device"] == "1" and line["source"] == "/dev/one")
        running.call(links["/dev/one"].send, sample(1))
        log.until(lambda line: line["event"] == "link" and line.get("kind") == "live")
        running.call(links["/dev/one"].send, b"W")
        who = log.until(lambda line: line["event"] == "identified")
        assert (who["device"], who["product"], who["serial_number"]) == ("1", "MTi-630", "03800001")
        assert running.client.post("/api/recordings/start", json={}).status_code < 300
        log.until(lambda line: line["event"] == "recording" and "began" in line["message"])
        gone = LinkError("gone", "/dev/one is gone.", "Was it unplugged?")
        running.call(links["/dev/one"].die, gone)
        lost = log.until(lambda line: line["event"] == "link" and line.get("kind") == "gone")
        assert (lost["level"], lost["message"]) == ("error", "/dev/one is gone. Was it unplugged?")
        running.client.post("/api/devices/1/retry")
        running.call(links["/dev/one"].send, sample(2))
        log.until(lambda line: line["event"] == "link" and line.get("kind") == "back")
        assert running.client.post("/api/recordings/stop").status_code < 300
        ended = log.until(lambda line: line["event"] == "recording" and "ended" in line["message"])
        assert ended["bytes"] > 0


def test_browsers_come_and_go(log: Log, tmp_path: Path) -> None:
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path), links.open) as running:
        with connect(running.ws, subprotocols=[Subprotocol(SUBPROTOCOL)]) as socket:
            socket.recv(PATIENCE_S)
            came = log.until(lambda line: line["event"] == "client" and "is connected" in line["message"])
            assert (came["client"], came["peer"]) == (1, "127.0.0.1")
        gone = log.until(lambda line: line["event"] == "client" and "has gone" in line["message"])
        assert (gone["client"], gone["dropped"]) == (1, 0)
        assert gone["sent_bytes"] > 0


def test_refusals_are_logged_without_the_token(log: Log, tmp_path: Path) -> None:
    guarded = Config(host="0.0.0.0", sources=("/dev/one",), data=tmp_path, control_token=CONTROL)
    with InProcessServer(guarded, links.open) as running:
        assert running.client.get(f"/api/devices?token=nonsense-{'x' * 8}").status_code == 401
        assert running.client.get("/api/devices", headers={"host": "evil.example"}).status_code == 403
        wrong = running.client.get("/api/devices", params={"token": CONTROL}, headers={"host": f"{'c' * 12}.example"})
        assert wrong.status_code == 403
        running.client.get("/?token=" + "c" * 12, follow_redirects=False)
    report = log.until(lambda line: line["event"] == "refused" and line["kind"] == "bad-token")
    assert (report["status"], report["path"], report["peer"]) == (401, "/api/devices", "127.0.0.1")
    log.until(lambda line: line["event"] == "refused" and line["kind"] == "bad-host")
    assert "nonsense" not in log.text
    assert CONTROL not in log.text
    assert json.dumps(CONTROL)[1:-1] not in log.text


def test_the_command_line_writes_one_object_a_line(tmp_path: Path) -> None:
    config = tmp_path / "imuscope.toml"
    config.write_text('view_token = "look-look-look"\ncontrol_token = "act-act-act"\nlog_format = "json"\n')
    with ServerProcess("sim:idtp?rate=10", data=tmp_path / "data", arguments=("--config", str(config))) as server:
        answer = get(f"{server.url}/api/devices", headers={"host": "evil.example", "cookie": "t=look-look-look"})
        assert answer.status_code == 403
        block_until(lambda: '"refused"' in server.log and '"live"' in server.log, lambda: server.log)
    messages = [json.loads(line) for line in server.lines if not line.startswith("http://")]
    assert {"start", "device", "link", "refused"} <= {line["event"] for line in messages}
    assert all({"time", "level", "event", "device", "message"} <= line.keys() for line in messages)
    assert "look-look-look" not in server.log
    assert "act-act-act" not in server.log


@each_row(("name", "value"), [("log_format", "xml"), ("log_level", "loud")])
def test_an_invalid_setting_is_refused(name: str, value: str) -> None:
    with pytest.raises(ConfigError, match=f"{name} '{value}' is not valid; allowed: "):
        load(**{name: value})


def record(text: str, level: int = logging.WARNING, **extra: Any) -> logging.LogRecord:
    made = logging.LogRecord("imuscope.test", level, __file__, 1, "%s", (text,), None)
    made.__dict__.update(extra)
    return made


def test_a_line_cannot_be_forged() -> None:
    """A path, a device's text or a file name may contain anything, but never starts a new log line."""
    line = logging_setup.TextFormatter([]).format(
        record("gone\n2026-01-01 00:00:00 info all is well\x1b[2J", device="1")
    )
    assert "\n" not in line
    assert "\x1b" not in line
    assert line.endswith("warning [1] gone\\n2026-01-01 00:00:00 info all is well\\x1b[2J")
    report = logging_setup.JsonFormatter([]).format(record("gone\n}"))
    assert "\n" not in report
    assert json.loads(report)["message"] == "gone\n}"


def test_times_are_utc_and_marked_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """The page and files have UTC: a line of the log has to be found by the time of an event there."""
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    time.tzset()
    try:
        made = record("here")
        made.created, made.msecs = 1_800_000_000.25, 250.0
        assert logging_setup.TextFormatter([]).format(made) == "2027-01-15 08:00:00.250Z warning here"
    finally:
        monkeypatch.undo()
        time.tzset()


def test_journal_lines_have_levels_and_no_time() -> None:
    journal = logging_setup.TextFormatter([], journal=True)
    assert journal.format(record("gone", logging.ERROR, device="2")) == "<3>[2] gone"
    assert journal.format(record("here", logging.INFO)) == "<6>here"


def test_secrets_go_wherever_they_stand() -> None:
    secrets = logging_setup.secrets_of("token-of-mine", "00", "@robot.key")
    assert secrets == ["token-of-mine"], "what is short or names a file is no secret, and stands in many a line"
    text = record("to http://host/?token=token-of-mine", device="1", data={"what": "token-of-mine"})
    for formatter in (logging_setup.TextFormatter(secrets), logging_setup.JsonFormatter(secrets)):
        assert "token-of-mine" not in formatter.format(text)
        assert "…" in formatter.format(text)


def test_frequent_messages_are_limited_and_counted() -> None:
    now = 0.0
    sparse = logging_setup.RateLimitFilter(lambda: now)
    written = [record(str(n), often="gaps") for n in range(100)]
    assert sum(sparse.filter(one) for one in written) == logging_setup.PER_PERIOD
    assert sparse.filter(record("another", often="rejects"))
    assert all(sparse.filter(record("rare")) for _ in range(100))
    now += logging_setup.PERIOD_S
    after = record("after", often="gaps")
    assert sparse.filter(after)
    assert (
        logging_setup.TextFormatter([])
        .format(after)
        .endswith(f"({100 - logging_setup.PER_PERIOD} more like this were not written.)")
    )
    for n in range(10_000):
        assert sparse.filter(record("who knows", often=n)), "as many keys as somebody likes"
    assert len(sparse._counts) <= 1000
