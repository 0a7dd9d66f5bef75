"""Webhooks of alarms, delivered to a real HTTP server that is well, slow, failing or gone."""

from __future__ import annotations

import asyncio
import socket
from pathlib import Path
from typing import Any, cast

import pytest

from imuscope.server.access.security_headers import WEBHOOK_HEADER
from imuscope.server.errors import DomainError
from imuscope.server.extensions.alarms.alarm_file import AlarmFile
from imuscope.server.extensions.alarms.definitions import AlarmDefinition, ExpressionCondition
from imuscope.server.extensions.alarms.service import AlarmService
from imuscope.server.extensions.alarms.settings import FILE, AlarmSettings
from imuscope.server.extensions.alarms.webhooks import (
    MAX_QUEUE,
    UndeliveredError,
    Webhooks,
    WebhookTiming,
    checked_url,
    post,
    shown_url,
)
from imuscope.server.settings.config import Config
from imuscope.server.streaming.telemetry import Telemetry
from tests.server.extensions.alarms.webhook_receiver import Receiver, receiver, receiving
from tests.support.each_row import each_row
from tests.support.fakes import FakeLinks, sample
from tests.support.free_ports import free_port
from tests.support.in_process_server import InProcessServer
from tests.support.recorder_harness import send
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until, until

QUICK = WebhookTiming(attempt_s=PATIENCE_S, first_pause_s=0.001, longest_pause_s=0.002, attempts=3)
Notices = list[tuple[str, str]]
HERE = ("127.0.0.1",)
__all__ = ["receiver"]  # a fixture


async def test_a_failing_receiver_is_tried_again_and_a_refusal_is_final(receiver: Receiver) -> None:
    hooks, report = Webhooks(QUICK, HERE), Notices()
    receiver.answers = [500, 429, 204, 404, 503, 503, 503]
    for number in range(4):
        hooks.send("a", receiver.url, {"number": number}, lambda level, text: report.append((level, text)))
    await until(lambda: len(report) == 2, "told")
    assert [body["number"] for body in receiver.bodies] == [0, 0, 0, 1, 2, 2, 2, 3]
    host = receiver.url.partition("/hook")[0]
    assert report == [
        ("warning", f"was not delivered to {host}/…: it answered 404 (one attempt). Later ones are tried."),
        ("info", f"is delivered to {host}/… again."),
    ]
    await hooks.close()


async def test_a_receiver_that_is_gone_is_reported_once_in_words() -> None:
    hooks, report = Webhooks(QUICK, HERE), Notices()
    url = f"http://ada:secret@127.0.0.1:{free_port()}/hook"
    for number in range(2):
        hooks.send("a", url, {"number": number}, lambda level, text: report.append((level, text)))
    await until(lambda: report, "told")
    [(level, text)] = report
    assert level == "warning"
    assert text.endswith("/…: no connection (Connection refused) (3 attempts). Later ones are tried.")
    assert "secret" not in text
    await hooks.close()


async def test_a_slow_receiver_delays_no_other_alarm_and_its_queue_is_bounded(receiver: Receiver) -> None:
    hooks, report = Webhooks(QUICK, HERE), Notices()
    other = Receiver()
    receiver.is_open.clear()
    hooks.send("slow", receiver.url, {"number": 0}, lambda level, text: report.append((level, text)))
    await until(lambda: receiver.bodies, "it waits for its answer")
    for number in range(1, MAX_QUEUE + 20):
        hooks.send("slow", receiver.url, {"number": number}, lambda level, text: report.append((level, text)))
    hooks.send("well", other.url, {"number": 0}, lambda level, text: report.append((level, text)))
    await until(lambda: other.bodies, "the other one is delivered")
    receiver.is_open.set()
    await until(lambda: len(receiver.bodies) >= MAX_QUEUE, "delivered after it")
    await until(lambda: not hooks.is_busy("slow"), "all that was queued is delivered")
    numbers = [body["number"] for body in receiver.bodies]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) <= MAX_QUEUE + 1
    assert report == []
    await hooks.close()
    await asyncio.to_thread(other.end)


async def test_an_attempt_ends_when_no_answer_comes(receiver: Receiver) -> None:
    hooks, report = Webhooks(WebhookTiming(attempt_s=0.2, first_pause_s=0.001, attempts=2), HERE), Notices()
    receiver.is_open.clear()
    hooks.send("a", receiver.url, {}, lambda level, text: report.append((level, text)))
    await until(lambda: report, "told")
    assert "no answer within 0.2 s (2 attempts)" in report[0][1]
    await hooks.close()


@each_row(
    ("url", "shown"),
    [
        ("https://user:password@host:8443/a?b=c", "https://host:8443/…"),
        ("http://[::1]:80/hook", "http://[::1]:80/…"),
        ("http://host", "http://host"),
        ("http://user@host", "http://host/…"),
        ("http://host?key=1", "http://host/…"),
        ("", ""),
    ],
)
def test_an_address_is_shown_without_secrets(url: str, shown: str) -> None:
    assert shown_url(url) == shown


def test_an_alarm_is_posted_with_its_address_hidden_and_kept(receiver: Receiver, tmp_path: Path) -> None:
    links = FakeLinks()
    url = receiver.url.replace("//", "//ada:pass%20word@")
    body = {
        "name": "Force",
        "condition": {"kind": "expression", "expression": "Force > 100 N"},
        "missing_s": 3600,
        "webhook": url,
    }
    config = Config(sources=("/dev/one",), protocol="fake", data=tmp_path, extensions=(AlarmSettings(HERE),))
    with InProcessServer(config, links.open) as running:
        answer = running.client.post("/api/alarms", json=body)
        assert answer.status_code == 201, answer.text
        alarm = answer.json()
        assert "secret" not in answer.text
        assert "word@" not in answer.text
        changed = {**alarm["definition"], "name": "Renamed"}
        assert running.client.post("/api/alarms/check", json=changed).json()["valid"]
        assert running.client.put(f"/api/alarms/{alarm['id']}", json=changed).status_code == 200
        send(running, links, "/dev/one", sample(1, 10) + sample(2, 150) + sample(3, 10))
        block_until(lambda: len(receiver.bodies) == 2, lambda: receiver.bodies)
        raised, cleared = receiver.bodies
        assert (raised["change"], cleared["change"]) == ("raised", "cleared")
        assert (raised["imuscope"], raised["name"], raised["value"], raised["unit"]) == (1, "Renamed", 150, "N")
        assert raised["text"] == "Alarm “Renamed”: Force is 150 N, above 100 N."
        assert raised["device"]["id"] == "1"
        assert receiver.paths == ["/hook?key=secret"] * 2
        assert receiver.authorizations == ["Basic YWRhOnBhc3Mgd29yZA=="] * 2
        texts = [one.text for one in running.call(lambda: list(running.services.telemetry.log))]
        assert not any("secret" in text or "word@" in text for text in texts)
    assert AlarmFile.load(tmp_path / FILE).alarms[0].definition.webhook == url


@each_row("url", ["ftp://host/", "host/hook", "http://", "http://host:0/", "http://ho st/", "http://a/…"])
def test_another_address_is_refused(url: str, tmp_path: Path) -> None:
    links = FakeLinks()
    body = {"name": "Link", "condition": {"kind": "health", "figure": "link"}, "webhook": url}
    with InProcessServer(Config(sources=("/dev/one",), protocol="fake", data=tmp_path), links.open) as running:
        answer = running.client.post("/api/alarms", json=body)
        assert answer.status_code == 422
        assert answer.json()["message"] == "webhook: this is not an address with http or https."


@each_row(
    ("url", "why"),
    [
        ("http://127.0.0.1:8080/api/recordings/start", "127.0.0.1 is this machine"),
        ("http://127.1.2.3/", "127.1.2.3 is this machine"),
        ("http://localhost/", "localhost is this machine"),
        ("http://LOCALHOST./", "localhost. is this machine"),
        ("http://a.localhost/", "a.localhost is this machine"),
        ("http://0.0.0.0/", "0.0.0.0 is this machine"),
        ("http://[::1]:22/", "::1 is this machine"),
        ("http://[::]/", ":: is this machine"),
        ("http://[::ffff:127.0.0.1]/", "::ffff:127.0.0.1 is this machine"),
        ("http://[::127.0.0.1]/", "::127.0.0.1 is this machine"),
        ("http://[64:ff9b::7f00:1]/", "64:ff9b::7f00:1 is this machine"),
        ("http://[64:ff9b:1::a9fe:1]/", "64:ff9b:1::a9fe:1 is a link-local address"),
        ("http://[2002:7f00:1::]/", "2002:7f00:1:: is this machine"),
        ("http://[2001:0:1:1::80ff:fffe]/", "2001:0:1:1::80ff:fffe is this machine"),
        ("http://[::ffff:0:127.0.0.1]/", "::ffff:0:127.0.0.1 is this machine"),
        ("http://[2001:db8::5efe:7f00:1]/", "2001:db8::5efe:7f00:1 is this machine"),
        ("http://0/", "0 is this machine"),
        ("http://127.1/", "127.1 is this machine"),
        ("http://2130706433/", "2130706433 is this machine"),
        ("http://0x7f000001/", "0x7f000001 is this machine"),
        ("http://0251.0376.1.1/", "0251.0376.1.1 is a link-local address"),
        ("http://[64:ff9b::808:808]/", ""),
        ("http://[2002:808:808::]/", ""),
        ("http://169.254.1.1/latest", "169.254.1.1 is a link-local address"),
        ("http://[fe80::1]/", "fe80::1 is a link-local address"),
        ("http://224.0.0.1/", "224.0.0.1 is not the address of one host"),
        ("http://10.1.2.3/", ""),
        ("https://192.168.7.1/", ""),
        ("https://[2001:db8::1]/", ""),
        ("https://example.org/hook", ""),
    ],
)
def test_this_machine_and_its_link_are_no_target_unless_a_setting_names_them(url: str, why: str) -> None:
    host = checked_url(url).hostname or ""
    checked_url(url, [host])
    if not why:
        checked_url(url, [])
        return
    with pytest.raises(DomainError) as refused:
        checked_url(url, ["another.example"])
    assert refused.value.message == f"webhook: {why}."
    assert "webhook_hosts" in refused.value.hint


def test_a_name_is_judged_by_the_address_that_is_connected_to(monkeypatch: pytest.MonkeyPatch) -> None:
    name = "hook.example"
    with receiving() as receiver:
        port = receiver.server_address[1]
        real, request = socket.getaddrinfo, []

        def rebinding(host: str, *more: Any, **words: Any) -> Any:
            request.append(host)
            return real("127.0.0.1" if host == "hook.example" else host, *more, **words)

        monkeypatch.setattr(socket, "getaddrinfo", rebinding)
        checked_url(f"http://{name}:{port}/", [])
        with pytest.raises(UndeliveredError, match=f"{name} is this machine: add it to webhook_hosts") as undelivered:
            asyncio.run(post(f"http://{name}:{port}/", {}, PATIENCE_S))
        assert undelivered.value.is_final
        assert request == [name]
        assert receiver.bodies == []


def test_a_webhook_posts_nothing_to_an_imuscope(tmp_path: Path) -> None:
    config = Config(sources=("/dev/one",), protocol="fake", data=tmp_path)
    with InProcessServer(config, FakeLinks().open) as running:
        for path in ("/api/recordings/start", "/", "/healthz"):
            with pytest.raises(UndeliveredError, match="it answered 403"):
                asyncio.run(post(f"{running.url}{path}", {}, PATIENCE_S, HERE))
        answer = running.client.get("/api/recorder", headers={WEBHOOK_HEADER: ""})
        assert (answer.status_code, answer.json()["kind"]) == (403, "own-webhook")
        assert not running.client.get("/api/recorder").json()["running"]


async def test_what_is_raised_while_an_alarm_is_changed_is_posted_to_its_new_address(
    receiver: Receiver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was left out, together with what waited for the former address."""
    telemetry = Telemetry.create(lambda: 1e9)
    alarms = AlarmService(telemetry.bus, telemetry.store, tmp_path, cast(Any, None), HERE)
    fast = ExpressionCondition(expression="Speed > 1 m/s")
    former, new = (AlarmDefinition(name="Fast", condition=fast, webhook=receiver.url + number) for number in "12")
    alarm = (await alarms.add(former)).id
    save = alarms._save

    async def save_while_it_is_raised() -> None:
        alarms.webhooks.send(alarm, former.webhook, {"number": 1}, lambda *_: None)
        alarms.webhooks.send(alarm, new.webhook, {"number": 2}, lambda *_: None)
        await save()

    monkeypatch.setattr(alarms, "_save", save_while_it_is_raised)
    receiver.is_open.clear()
    await alarms.change(alarm, new)
    assert alarms.webhooks.is_busy(alarm)
    receiver.is_open.set()
    await until(lambda: not alarms.webhooks.is_busy(alarm), "it is posted")
    assert 2 in [one["number"] for one in receiver.bodies]
    await alarms.close()
