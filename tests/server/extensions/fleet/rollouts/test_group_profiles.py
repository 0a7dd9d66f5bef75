"""Settings of robots against the profile of their group, from a simulated sensor to the answer of the fleet server."""

from __future__ import annotations

import asyncio
import contextlib
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.model.device_settings import (
    MAX_SETTINGS,
    DeviceSettings,
    decode_settings,
    difference,
    encode_settings,
    writable_settings,
)
from imuscope.server.extensions.fleet.model.reports import ReportError, RobotDevice
from imuscope.server.extensions.fleet.rollouts.group_profiles import FILE, GroupProfiles
from imuscope.server.extensions.fleet.store.known_settings import KnownSettings
from tests.server.extensions.fleet.compared_robots import PRODUCT, robot, settings_at
from tests.support.control_harness import house_of, outputs
from tests.support.free_ports import free_port
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, get
from tests.support.waiting import block_until


def learned(folder: Path, *settings: DeviceSettings) -> GroupProfiles:
    profiles = GroupProfiles(folder)
    for one in settings:
        assert profiles.learn(encode_settings(one)) == one.digest
    return profiles


def test_a_robot_that_differs_is_reported_with_its_differences(tmp_path: Path) -> None:
    right, wrong = settings_at(100), settings_at(400)
    profiles = learned(tmp_path, right, wrong)
    first, second = robot("a", right), robot("b", wrong)
    assert profiles.judged(second).settings == "unknown"
    profile = profiles.use(first, first.devices[0], "  Anna  B. ", 1_700_000_000.0)
    assert (profile.robot, profile.by, profile.group) == ("a", "Anna B.", "otters")
    assert (profiles.judged(first).settings, profiles.judged(first).drifted) == ("as-profile", 0)
    assert (profiles.judged(second).settings, profiles.judged(second).drifted) == ("drifted", 1)
    results = profiles.check("otters", second.devices[0]).difference
    assert results is not None
    assert [(row.left, row.right) for row in results.rows] == [("400 Hz", "100 Hz")]
    assert profiles.judged(robot("c", wrong, "herons")).settings == "unknown"
    assert profiles.judged(robot("d", None)).settings == "unknown"
    assert profiles.judged(robot("d", None)).devices[0].expected_rate == 100  # as the profile has it


def test_a_profile_outlives_the_server_and_can_be_removed(tmp_path: Path) -> None:
    right = settings_at(100)
    first = robot("a", right)
    learned(tmp_path, right).use(first, first.devices[0], "Anna", 5.0)
    again = learned(tmp_path, right)
    assert again.judged(first).settings == "as-profile"
    with pytest.raises(DomainError, match="name of the person"):
        again.remove(first, first.devices[0], " ")
    again.remove(first, first.devices[0], "Anna")
    assert again.judged(first).settings == "unknown"
    assert learned(tmp_path, right).judged(first).settings == "unknown"


def test_a_file_of_profiles_that_is_damaged_does_not_stop_the_server(tmp_path: Path) -> None:
    right = settings_at(100)
    first = robot("a", right)
    learned(tmp_path, right).use(first, first.devices[0], "Anna", 5.0)
    whole = (tmp_path / FILE).read_bytes()
    for damaged in (whole[: len(whole) // 2], b"", b"[]", b"\xff" * 20):
        (tmp_path / FILE).write_bytes(damaged)
        profiles = GroupProfiles(tmp_path)
        assert "cannot be read" in profiles.problem
        assert profiles.judged(first).settings == "unknown"


def test_settings_are_requested_once_for_all_robots_that_have_them(tmp_path: Path) -> None:
    profiles, right = GroupProfiles(tmp_path), settings_at(100)
    for name in "abc":
        profiles.judged(robot(name, right))
    assert list(profiles.questions(0.0, 10)) == [("a", "1")]
    assert list(profiles.questions(1.0, 10)) == []
    assert list(profiles.questions(6.0, 10)) == [("b", "1")]  # the first one did not answer
    profiles.learn(encode_settings(right))
    assert list(profiles.questions(60.0, 10)) == []


def test_settings_of_a_device_that_is_gone_are_not_requested(tmp_path: Path) -> None:
    """They were asked for as long as the robot was live."""
    profiles, there = GroupProfiles(tmp_path), robot("a", settings_at(100))
    profiles.judged(there)
    profiles.judged(there.model_copy(update={"devices": []}))
    assert list(profiles.questions(0.0, 10)) == []
    assert not profiles._unknown_digests


def test_settings_that_no_robot_has_sent_cannot_be_a_profile(tmp_path: Path) -> None:
    first = robot("a", settings_at(100))
    with pytest.raises(DomainError, match="not known"):
        GroupProfiles(tmp_path).use(first, first.devices[0], "Anna", 5.0)


def test_the_digest_is_that_of_the_content() -> None:
    assert settings_at(100).digest == settings_at(100).digest != settings_at(200).digest
    assert decode_settings(encode_settings(settings_at(100))) == settings_at(100)
    assert encode_settings(settings_at(100, Big={"text": "x" * MAX_SETTINGS})) == b""


def test_what_the_device_reports_by_itself_is_left_out() -> None:
    driver = PROTOCOLS["xbus"].configuration.driver
    assert driver is not None
    values = {**settings_at(100).values, "ProductCode": {"product_code": PRODUCT}, "Temperature": {"temperature": 3}}
    assert set(writable_settings(driver, settings_at(100).context, values)) == {"OutputConfiguration"}


values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats() | st.text(max_size=8) | st.binary(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=10,
)
names = st.sampled_from(["OutputConfiguration", "FilterProfile", "Baudrate", "AlignmentRotation", "x"])
fields = st.sampled_from(["outputs", "profile", "rate", "data_identifier", "output_frequency", "q0", "y"])


@given(st.dictionaries(names, st.dictionaries(fields, values, max_size=3), max_size=4), st.binary(max_size=60))
def test_settings_of_any_shape_do_no_harm(shapes: dict[str, Any], noise: bytes) -> None:
    driver = PROTOCOLS["xbus"].configuration.driver
    assert driver is not None
    answer = {"protocol": "xbus", "product": PRODUCT, "firmware": "1", "values": shapes}
    for data in (msgspec.msgpack.encode(answer), noise):
        with contextlib.suppress(ReportError):
            result = decode_settings(data)
            difference(driver, settings_at(100), result)


def test_from_a_simulated_sensor_to_the_answer(tmp_path: Path) -> None:
    bus = f"tcp/127.0.0.1:{free_port()}"
    config = tmp_path / "robot.toml"
    config.write_text(f'[fleet]\nrouter = "{bus}"\nname = "otter-7"\ngroup = "otters"\n')
    source, arguments = "sim:xbus?product=MTi-630", ("--config", str(config))

    def send(url: str, body: object) -> httpx.Response:
        return httpx.post(url, json=body, timeout=PATIENCE_S)

    with ServerProcess(data=tmp_path / "fleet", arguments=("--listen", bus), command="fleet") as fleet:
        at = f"{fleet.url}/api/fleet/robots"

        def shown() -> dict[str, Any]:
            return next(iter(get(at).json()["robots"]), {"devices": [], "settings": "", "state": ""})

        def device() -> dict[str, Any]:
            return next(iter(shown()["devices"]), {"settings": "", "serial_number": ""})

        def use() -> httpx.Response:
            return send(f"{at}/otter-7/profile", {"device": "1", "by": "Anna"})

        with ServerProcess(source, data=tmp_path / "robot", arguments=arguments) as robot:
            block_until(lambda: device()["serial_number"], "the device is known")
            assert device()["settings"] == ""
            assert use().status_code == 409
            assert send(f"{robot.url}/api/devices/1/read", {}).status_code == 202
            block_until(lambda: device()["settings"], "the settings were read")
            digest = device()["settings"]
            assert device()["expected_rate"] == pytest.approx(100)
            block_until(lambda: use().status_code == 200, "the robot has sent its settings")
            assert (shown()["settings"], shown()["drifted"]) == ("as-profile", 0)
            outputs = [{"data_identifier": 0x2010, "output_frequency": 50}]
            change = {"changes": {"OutputConfiguration": {"outputs": outputs}}, "confirmed": True}
            assert send(f"{robot.url}/api/devices/1/apply", change).status_code == 202
            block_until(lambda: device()["settings"] != digest, "the change is reported")
            block_until(lambda: shown()["settings"] == "drifted", "and compared")
            rows = get(f"{at}/otter-7/settings").json()[0]["rows"]
            assert ("50 Hz", "100 Hz") in [(row["robot"], row["profile"]) for row in rows]
            changed = device()["settings"]
        # after a restart the robot knows its settings without reading them again
        with ServerProcess(source, data=tmp_path / "robot", arguments=arguments):
            block_until(lambda: shown()["state"] == "live" and device()["settings"] == changed, "it joins again")
            block_until(lambda: shown()["settings"] == "drifted", "and is compared")
        texts = [one["text"] for one in get(f"{fleet.url}/api/fleet/events").json()]
        assert any("are the profile of the group otters now: Anna" in text for text in texts)
        removed = httpx.delete(f"{at}/otter-7/profile?device=1&by=Ben", timeout=PATIENCE_S)
        assert removed.status_code == 200
        assert shown()["settings"] == "unknown"


async def test_a_write_is_reported_even_if_a_report_is_made_in_the_middle_of_it(tmp_path: Path) -> None:
    """A write once changed values that a report had kept to compare them, so that none ever told of it."""
    async with house_of("sim:xbus?product=MTi-630", tmp_path, is_read=True) as (here, desk):
        known, device = (
            KnownSettings(tmp_path / "fleet", here.desks.get),
            RobotDevice(desk.device, "MTi", "live"),
        )
        before = known.with_settings((device,))[0].settings
        task = desk.add(
            "Write", partial(here.desks.jobs.apply, changes={"OutputConfiguration": outputs(20)}, reason="")
        )
        while not task.finished.is_set():
            known.with_settings((device,))
            await asyncio.sleep(0)
        assert task.job.state == "done"
        after = known.with_settings((device,))[0].settings
        assert after not in ("", before)
        assert after == KnownSettings(tmp_path / "new", here.desks.get).with_settings((device,))[0].settings
