"""Preconditions of alarms: a row for each state in which a condition cannot be judged, and what must be said of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from imuscope.server import wire
from imuscope.server.errors import DomainError
from imuscope.server.extensions.alarms.definitions import (
    AlarmDefinition,
    Figure,
    FlagCondition,
    HealthCondition,
    StoredAlarm,
)
from imuscope.server.extensions.alarms.figures import HealthJudge
from imuscope.server.extensions.alarms.instance import AlarmInstance, compiled
from imuscope.server.extensions.alarms.machine import BEYOND, UNKNOWN, WITHIN
from imuscope.server.streaming.telemetry import Telemetry
from tests.support.each_row import each_row

BEGIN = 1_700_000_000.0
CHANNELS = ("PacketCounter", "Acceleration")
LIMITS: dict[Figure, float] = {"rate": 95.0, "loss": 5.0, "silence": 3.0, "clock": 5.0, "link": 0.0}


class Device:
    """A device at 100 Hz whose figures the test sets, judged twice a second."""

    def __init__(self, figure: Figure, channels: Sequence[str] = CHANNELS, protocol: str = "xbus") -> None:
        self.judge = HealthJudge(HealthCondition(kind="health", figure=figure, limit=LIMITS[figure]), channels)
        self.info = wire.DeviceInfo("1", "IMU", "sim:xbus", "serial", "live", protocol)
        self.now, self.lost = BEGIN, 0
        self.arrived: float | None = None
        self.counts: dict[str, int] = {}
        self.figures: dict[str, Any] = {"rate": 100.0, "drift_ppm": 3.0, "uncertainty_ms": 0.5, "behind": wire.Behind()}
        self.last = UNKNOWN, 0.0

    def run(self, seconds: float, rate: float = 100.0, lost: int = 0, message: str = "MTData2") -> Device:
        """Let it send for some seconds, and lose samples in each half second."""
        for _ in range(round(2 * seconds)):
            self.now += 0.5
            self.counts[message] = self.counts.get(message, 0) + round(rate / 2)
            self.lost += lost
            self.arrived = self.now if rate else self.arrived
            self.last = self.judge.judge(self.info, self.health(), self.now)
        return self

    def health(self) -> wire.DeviceHealth:
        """Its figures now."""
        messages = [wire.MessageHealth(name, 0.0, count) for name, count in self.counts.items()]
        counted = {"gaps": 0, "lost": self.lost, "rejects": 0, "bytes": 0, "bytes_per_s": 0.0, "capacity": None}
        return wire.DeviceHealth(
            device="1",
            time=self.now,
            messages=messages,
            last_arrival=self.arrived,
            numbered=sum(self.counts.values()),
            jitter_ms=None,
            **counted,
            **self.figures,
        )

    def set(self, status: wire.DeviceStatus = "live", **figures: Any) -> Device:
        """Change its state and its figures."""
        self.info.status = status
        self.figures |= figures
        return self


def of(name: str, device: Device, expected: Any) -> Any:
    return f"{device.judge.subject}, {name}", device, expected


ENDED = "The source has ended. Play it again, or disable the alarm."
BEHIND = "Decoding is 12 s behind the data received. Reduce the load of this computer."
OPENING = "The link is being opened. Wait for"
UNNUMBERED = "The device does not number its samples: lost ones cannot be counted."
UNJUDGED = [
    *(of("of a file that has ended", Device(one).run(20).set("ended").run(20, 0), ENDED) for one in LIMITS),
    of("decoding behind", Device("rate").run(20).set(behind=wire.Behind(decoding=12.0), rate=3.0).run(5), BEHIND),
    of("decoding behind", Device("loss").run(20, lost=9).set(behind=wire.Behind(decoding=12.0)).run(5), BEHIND),
    of("decoding behind", Device("silence").run(20).set(behind=wire.Behind(decoding=12.0)).run(12, 0), BEHIND),
    *(of("link not open yet", Device(one).set("connecting", rate=0.0).run(20, 0), OPENING) for one in ("rate", "link")),
    of("link not open yet", Device("clock").set("connecting", uncertainty_ms=16.0).run(3, 0), OPENING),
    of("nothing has arrived", Device("silence").set("connecting").run(3, 0), "The silence is not known yet. Wait for"),
    of("first second", Device("rate").set(rate=3.0).run(1.5), "Since the device sends, 1 s of 2 s have passed"),
    of("first seconds", Device("loss").run(1, lost=30), "Since the device sends, 0 s of 10 s have passed"),
    of(
        "first seconds",
        Device("clock").set(drift_ppm=None, uncertainty_ms=14.0).run(2),
        "The drift of the clock is not",
    ),
    of("device lost", Device("clock").run(9).set("lost", uncertainty_ms=9.0).run(9, 0), "The device does not send"),
    of("protocol without counters", Device("loss", protocol="isb").run(20), UNNUMBERED),
    of("counter not sent", Device("loss", channels=("Acceleration",)).run(20), UNNUMBERED),
    of("no samples any more", Device("loss").run(20).set("lost").run(20, 0), "The share of lost samples is not known"),
    of(
        "decoding has caught up",
        Device("rate").run(9).set(behind=wire.Behind(decoding=3.0)).run(2).set(behind=wire.Behind(), rate=9.0).run(1),
        "0 s of",
    ),
]


@each_row(("device", "words"), [row[1:] for row in UNJUDGED], ids=[row[0] for row in UNJUDGED])
def test_a_figure_that_is_not_known_is_not_judged_and_the_reason_is_given(device: Device, words: str) -> None:
    """Regression: a rate alarm was raised in the first second of a device, and a file that had ended was silent."""
    assert device.last[0] == UNKNOWN
    assert words in device.judge.obstacle
    assert device.judge.obstacle.endswith(".")


JUDGED = [
    of("even", Device("rate").run(5), WITHIN),
    of("low", Device("rate").set(rate=60.0).run(5, 60), BEYOND),
    of("while the link stalls", Device("rate").run(5).set("lost", rate=0.0).run(2, 0), WITHIN),  # and catches up
    of("of a device that was lost", Device("rate").run(5).set("lost", rate=0.0).run(5, 0), BEYOND),
    of("none lost", Device("loss").run(20), WITHIN),
    of("one in ten", Device("loss").run(20, 90, lost=5), BEYOND),
    of("no number, but some lost", Device("loss", protocol="isb").run(20, 90, lost=5), BEYOND),
    of("another message after a change of its outputs", Device("loss").run(900).run(20, 100, 1, "Other"), WITHIN),
    of("a false one is taken back", Device("loss").run(20, lost=5).run(0.5, lost=-195).run(5), WITHIN),
    of("of a device that sends", Device("silence").run(5), WITHIN),
    of("of a lost device", Device("silence").run(5).set("lost").run(5, 0), BEYOND),
    of("well known", Device("clock").run(5), WITHIN),
    of("behind a bad network", Device("clock").set(uncertainty_ms=9.0).run(5), BEYOND),
    of("open", Device("link").run(5), WITHIN),
    of("lost", Device("link").run(5).set("lost").run(1, 0), BEYOND),
]


@each_row(("device", "code"), [row[1:] for row in JUDGED], ids=[row[0] for row in JUDGED])
def test_a_figure_that_is_known_is_judged(device: Device, code: int) -> None:
    """Regression: where another message became the most frequent one, one lost sample was a loss of 100 %."""
    assert device.last[0] == code
    assert device.judge.obstacle == ""


# ── alarms ───────────────────────────────────────────────────────────────────────────────────────────────────────────

ATTITUDE = wire.ChannelInfo(
    1, "1", "Quaternion", "Quaternion", "", "quaternion", "", "", [wire.ColumnInfo(one, "f8", "") for one in "wxyz"]
)
STATUS_BITS = [wire.BitsInfo("FilterValid", 1, 1), wire.BitsInfo("ClipAccX", 8, 1)]
STATUS = wire.ChannelInfo(
    2, "1", "StatusWord", "StatusWord", "", "status", "", "", [wire.ColumnInfo("value", "u4", "", bits=STATUS_BITS)]
)


class Alarm:
    """One alarm of a device, fed by the test."""

    def __init__(self, condition: dict[str, Any], **more: Any) -> None:
        self.now = BEGIN
        telemetry = Telemetry.create(lambda: self.now)
        self.info = wire.DeviceInfo("1", "IMU", "sim:xbus", "serial", "live", "xbus")
        definition = AlarmDefinition.model_validate({"name": "Test", "condition": condition, **more})
        infos, rates = [ATTITUDE, STATUS], {1: 100.0, 2: 100.0}
        self.instance = AlarmInstance(
            StoredAlarm(id="a", definition=definition), self.info, infos, rates, telemetry.bus, "1"
        )
        self.log = telemetry.log

    def turn(self, degrees: float, seconds: float = 0.5) -> None:
        """Samples of the attitude, turned about the vertical; NaN: without a value."""
        n = round(100 * seconds)
        time = self.now + np.arange(1, n + 1) / 100
        self.now = float(time[-1])
        half = np.radians(degrees) / 2
        columns = [np.full(n, value) for value in (np.cos(half), 0 * half, 0 * half, np.sin(half))]
        self.instance.feed({1: [time, time, *columns]})
        self.instance.tick(self.now)

    @property
    def state(self) -> Any:
        return self.instance.state()


def expression(text: str) -> dict[str, Any]:
    return {"kind": "expression", "expression": text}


def test_angles_have_the_names_of_the_plots_in_conditions() -> None:
    """Regression: EulerAngles.yaw, as the plots and expressions name it, was not found in a condition."""
    alarm = Alarm(expression("EulerAngles.yaw > 10 °"))
    alarm.turn(5.0)
    assert (alarm.state.status, alarm.state.problem) == ("ok", "")
    assert (alarm.state.unit, alarm.state.signals) == ("°", ["EulerAngles.yaw"])
    alarm.turn(25.0)
    assert alarm.state.status == "raised"
    assert alarm.state.value == pytest.approx(25.0)
    assert Alarm(expression("norm(EulerAngles) > 1 °")).state.signals == [
        f"EulerAngles.{one}" for one in ("roll", "pitch", "yaw")
    ]
    stored = Alarm(expression("euler(Quaternion) > 10 °"))
    stored.turn(25.0)
    assert stored.state.status == "raised", "conditions that are stored go on"


def test_a_window_that_is_not_full_states_nothing() -> None:
    """Regression: the mean of the first hundredth of a window of 2 s raised an alarm."""
    alarm = Alarm(expression("mean(EulerAngles.yaw, 2 s) < 10 °"))
    alarm.turn(5.0)
    assert alarm.state.status == "missing"
    assert alarm.state.problem == "A moving window is not full yet; it restarts after a gap. Wait until it is."
    alarm.turn(5.0, 2.0)
    assert (alarm.state.status, alarm.state.problem) == ("raised", "")


def test_samples_without_a_value_are_no_data() -> None:
    """Regression: an alarm stayed "ok" while its signal had no value for minutes."""
    alarm = Alarm(expression("EulerAngles.yaw > 10 °"))
    alarm.turn(5.0)
    for _ in range(10):
        alarm.turn(float("nan"))
    assert alarm.state.status == "missing"
    assert alarm.state.problem.startswith("The samples hold no values that can be compared.")
    assert list(alarm.log)[-1].text == f"Alarm “Test” cannot be evaluated: {alarm.state.problem}"


def test_a_figure_that_is_unknown_for_long_is_no_data() -> None:
    """Regression: an alarm on a figure stayed "ok" after the figure had become unknown."""
    alarm, device = Alarm({"kind": "health", "figure": "silence", "limit": 3.0}), Device("silence")
    alarm.instance.feed_health(device.info, device.run(1).health(), BEGIN + 1)
    assert (alarm.state.status, alarm.state.problem) == ("ok", "")
    health = device.set(behind=wire.Behind(decoding=12.0)).run(1, 0).health()
    alarm.instance.feed_health(device.info, health, BEGIN + 2)
    assert (alarm.state.status, alarm.state.problem) == ("ok", BEHIND)
    alarm.instance.feed_health(device.info, health, BEGIN + 9)
    alarm.instance.tick(BEGIN + 9)
    assert alarm.state.status == "missing"
    assert list(alarm.log)[-1].text == f"Alarm “Test” cannot be evaluated: {BEHIND}"


def test_an_alarm_on_samples_states_that_decoding_is_behind() -> None:
    alarm = Alarm(expression("EulerAngles.yaw > 10 °"))
    alarm.turn(5.0)
    alarm.instance.feed_health(alarm.info, Device("rate").set(behind=wire.Behind(decoding=12.0)).health(), alarm.now)
    assert alarm.state.problem == BEHIND
    alarm.instance.feed_health(alarm.info, Device("rate").health(), alarm.now)
    assert alarm.state.problem == ""


def test_a_flag_that_a_product_does_not_have_is_no_condition() -> None:
    """Regression: "FilterValid is clear" was raised for good on a product without a filter."""
    condition = FlagCondition(kind="flag", signal="StatusWord", flag="FilterValid", is_set=False)
    definition = AlarmDefinition(name="Filter", condition=condition)
    device = wire.DeviceInfo("1", "IMU", "sim:xbus", "serial", "live", "xbus", "MTi-610", absent=["FilterValid"])
    with pytest.raises(DomainError, match="MTi-610 does not have the flag FilterValid"):
        compiled(definition, [STATUS], {}, device)
    assert compiled(definition, [STATUS], {}).subject == "FilterValid"
