"""Failing cables, ports and networks, and the outcome for data in transit.

fault                                   outcome
unplugged, back under another number    found by the adapter's lasting name; a notice says where it is now
… while another adapter has its name    not taken for it: said so, waited for
a hub is reset with all its ports       each device is found by its own name, and has its own bytes
unplugged while it is recorded          every byte of before and after is there; the hole is told as an event
the device changes its rate by itself   the bytes are noise: rejected and counted, the person is asked for the rate
garbage for a minute                    counted, two events a second at most, memory bounded; the next frame counts
half a frame, then silence              given up after a quarter of a second and counted; the next frame is whole
half a frame while we were held up      no byte is given up for a silence that was ours
port held by another process            its name and number are told; opened as soon as that one lets go
another program opens the port later    left to it, with its name, when bytes are missing; opened again when it ends
TCP: peer gone without a word           told lost within a second, found dead by keep-alive, connected again
UDP: nothing for a while                told lost; the same port hears the next datagram
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import socket
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from imuscope.server.devices.link.session import Session
from tests.fault_injection.fault_harness import FaultHarness, frames, notice_of, stage
from tests.server.links.link_fixtures import Pty, device, program_with, pty
from tests.support.each_row import each_row
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import until

TCP_REPAIR = 19  # Linux: closing such a socket does not notify the other side


def plug(port: Pty, names: Path, number: int, serial: str = "A5028") -> str:
    """Give a pseudo-terminal the names that udev gives a USB adapter; returns the numbered one."""
    (names / "by-id").mkdir(exist_ok=True)
    place = names / f"ttyUSB{number}"
    for link in (place, names / "by-id" / f"usb-FTDI_{serial}-if00-port0"):
        link.unlink(missing_ok=True)
        link.symlink_to(port.path)
    return str(place)


def unplug(port: Pty, names: Path, number: int, serial: str = "A5028") -> None:
    (names / f"ttyUSB{number}").unlink()
    (names / "by-id" / f"usb-FTDI_{serial}-if00-port0").unlink()
    port.pull()


async def streams(port: Pty, here: FaultHarness) -> None:
    """Twenty frames come in at the port, once it is open."""
    await until(lambda: "is open" in here.info.message, "it is open")
    port.let_go()
    port.write(frames(0, 20))
    await until(here.status("live"), "it streams")


async def test_unplugged_and_back_under_another_number(tmp_path: Path) -> None:
    with pty() as first, pty() as second:
        place = plug(first, tmp_path, 0)
        async with stage(f"serial://{place}?baud=115200", tmp_path / "by-id") as here:
            await streams(first, here)
            unplug(first, tmp_path, 0)
            await until(here.status("lost"), "it is gone")
            assert "gone" in notice_of(here.info)[0] or "no port" in notice_of(here.info)[0]
            plug(second, tmp_path, 1)
            await until(lambda: here.info.notices, "it is open again")
            assert f"came back as {second.path}" in here.info.notices[0]
            assert "by-id" in here.info.notices[0]
            second.let_go()
            second.write(frames(30, 50))
            await until(here.status("live"), "it streams again")
            await until(lambda: here.samples == 40, "all samples are there")
            assert here.bytes == frames(0, 20) + frames(30, 50)
            (hole,) = here.events("gap")
            assert "the link was down" in hole.text


async def test_a_hub_is_reset_with_all_its_ports(tmp_path: Path) -> None:
    """All adapters go at once and come back under each other's numbers: each device has its own bytes."""
    serials = ["A1", "B2", "C3"]
    with contextlib.ExitStack() as ports:
        before, after = ([ports.enter_context(pty()) for _ in serials] for _ in range(2))
        places = [plug(port, tmp_path, k, serials[k]) for k, port in enumerate(before)]
        sources = [f"serial://{place}?baud=115200" for place in places]
        async with stage(sources[0], tmp_path / "by-id") as here:
            sessions = [here.session, *map(here.sessions.add, sources[1:])]
            received: list[list[bytes]] = [[] for _ in sessions]

            def listen(session: Session, chunks: list[bytes]) -> None:
                session.listeners.chunks(lambda came, way: chunks.extend(one.data for one in came if way == "rx"))

            def are(status: str) -> Callable[[], bool]:
                return lambda: all(one.info.status == status for one in sessions)

            for pair in zip(sessions, received, strict=True):
                listen(*pair)
            await until(lambda: all("is open" in one.info.message for one in sessions), "all are open")
            for k, port in enumerate(before):
                port.let_go()
                port.write(frames(100 * k, 100 * k + 20))
            await until(are("live"), "all stream")
            for k, port in enumerate(before):
                unplug(port, tmp_path, k, serials[k])
            await until(are("lost"), "all are gone")
            for k, port in enumerate(after):
                plug(port, tmp_path, (k + 1) % 3, serials[k])
            await until(lambda: all(one.info.notices for one in sessions), "all are open again")
            for k, port in enumerate(after):
                port.let_go()
                port.write(frames(100 * k + 30, 100 * k + 50))
            await until(are("live"), "all stream again")
            for k, chunks in enumerate(received):
                expected = frames(100 * k, 100 * k + 20) + frames(100 * k + 30, 100 * k + 50)
                await until(lambda: b"".join(chunks) == expected, "its bytes are there")  # noqa: B023 - awaited here
            assert {event.device for event in here.events("gap")} == {one.info.id for one in sessions}


async def test_another_adapter_is_not_mistaken_for_the_previous_one(tmp_path: Path) -> None:
    with pty() as first, pty() as other, pty() as back:
        place = plug(first, tmp_path, 0)
        async with stage(f"serial://{place}?baud=115200", tmp_path / "by-id") as here:
            await streams(first, here)
            unplug(first, tmp_path, 0)
            plug(other, tmp_path, 0, "B777")
            await until(lambda: "Another adapter" in here.info.message, "the other one is refused")
            assert "B777" in notice_of(here.info)[0]
            plug(back, tmp_path, 1)
            await until(lambda: here.info.notices, "its own is open")
            back.let_go()
            back.write(frames(20, 40))
            await until(lambda: here.samples == 40, "its samples are there")
            assert here.bytes == frames(0, 40)


async def test_garbage_for_a_minute(tmp_path: Path) -> None:
    """A minute of noise at 115 200 Bd, at once."""
    noise = random.Random(7).randbytes(60 * 11_520)
    with pty() as port:
        async with stage(f"serial://{port.path}?baud=115200&protocol=xbus") as here:
            await until(lambda: "is open" in here.info.message, "it is open")
            await asyncio.to_thread(write_all, port, frames(0, 50))
            await until(here.status("live"), "it streams")
            began, events = time.monotonic(), len(here.telemetry.log)
            await asyncio.to_thread(write_all, port, noise)
            await asyncio.to_thread(write_all, port, frames(50, 1000))
            sent = frames(0, 50) + noise + frames(50, 1000)
            await until(lambda: len(here.bytes) == len(sent), "all bytes came")
            await until(lambda: here.health.rejects > 100, "what was refused is counted")
            await until(lambda: here.samples >= 999, "the frames after it are there")
            assert here.bytes == sent
            seconds = time.monotonic() - began
            assert len(here.telemetry.log) - events <= 6 * (seconds + 2), "nobody is flooded with events"
            assert here.info.status == "live"


def write_all(port: Pty, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(port.master, view) :]


async def test_half_a_frame_then_silence() -> None:
    with pty() as port:
        async with stage(f"serial://{port.path}?baud=115200&protocol=xbus") as here:
            await until(lambda: "is open" in here.info.message, "it is open")
            port.write(frames(0, 20) + frames(20, 21)[:30])
            await until(lambda: here.health.rejects == 1, "the half is given up and counted")
            assert here.samples == 20
            port.write(frames(21, 40))
            await until(lambda: here.samples == 39, "what follows is whole")
            await until(lambda: here.health.lost == 1, "the one is counted as lost")


async def test_half_a_frame_while_the_server_was_held_up() -> None:
    """Regression: on a busy host a half-received frame was given up although the rest was in the kernel's buffer."""
    with pty() as port:
        async with stage(f"serial://{port.path}?baud=115200&protocol=xbus") as here:
            await until(lambda: "is open" in here.info.message, "it is open")
            whole = frames(20, 21)
            port.write(frames(0, 20) + whole[:30])
            await until(lambda: here.samples == 20, "the frames are there")
            port.write(whole[30:] + frames(21, 40))
            # The server is stopped: afterwards everything due arrives at once, in any order.
            time.sleep(0.6)
            here.sessions.tick()
            await until(lambda: here.samples == 40, "every frame is there")
            assert (here.health.rejects, here.health.lost) == (0, 0)
            assert here.events("link")[-1].data["kind"] != "silent"


async def test_a_port_held_by_another_process_is_opened_when_that_one_ends() -> None:
    with pty() as port, program_with(port.path, "O_RDWR", "lock") as other:
        port.let_go()
        async with stage(f"serial://{port.path}?baud=115200") as here:
            await until(lambda: "in use" in here.info.message, "it is told")
            words, hint = notice_of(here.info)
            assert f"(process {other.pid})" in words
            assert "--share" in hint
            other.communicate()
            await until(lambda: "open" in here.info.message, "it is opened without being asked")
            port.write(frames(0, 20))
            await until(lambda: here.samples == 20, "it streams")


async def test_a_port_that_another_program_opens_later_is_left_to_it() -> None:
    """Regression: each of the two got a part of the bytes, and nobody knew why."""
    with pty() as port:
        async with stage(f"serial://{port.path}?baud=115200") as here:
            await until(lambda: "open" in here.info.message, "it is opened")
            port.write(frames(0, 20))
            await until(here.status("live"), "it streams")
            with program_with(port.path, "O_RDWR") as other:
                port.write(frames(30, 40))  # the other program took ten frames
                await until(lambda: "in use" in here.info.message, "the port is left to the other program")
                words, hint = notice_of(here.info)
                assert f"(process {other.pid})" in words
                assert "--share" in hint
            await until(lambda: here.info.is_open, "it is opened again")
            port.write(frames(50, 60))
            await until(lambda: here.samples == 40, "it streams again")


async def test_a_tcp_peer_that_vanishes_silently() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(PATIENCE_S)
        async with stage(f"tcp://127.0.0.1:{server.getsockname()[1]}") as here:
            device, _ = await asyncio.to_thread(server.accept)
            device.sendall(frames(0, 20))
            await until(here.status("live"), "it streams")
            try:
                device.setsockopt(socket.IPPROTO_TCP, TCP_REPAIR, 1)
            except PermissionError:
                device.close()
                pytest.skip("a peer that says nothing needs the right to administer the network")
            device.close()
            await until(here.status("lost"), "its silence is told")
            assert notice_of(here.info)
            again, _ = await asyncio.to_thread(server.accept)
            with again:
                again.sendall(frames(40, 60))
                await until(here.status("live"), "it streams again")
                await until(lambda: here.samples == 40, "all samples are there")
                assert here.bytes == frames(0, 20) + frames(40, 60)
                assert "the link was down" in here.events("gap")[-1].text


async def test_udp_silence_and_recovery() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device:
        async with stage(f"udp://127.0.0.1:{port}?protocol=xbus") as here:
            await until(lambda: here.info.notices, "it listens")
            for n in range(10):
                device.sendto(frames(n, n + 1), ("127.0.0.1", port))
                await asyncio.sleep(0.01)
            await until(here.status("live"), "it streams")
            await until(here.status("lost"), "its silence is told")
            assert "No data" in notice_of(here.info)[0]
            for n in range(15, 25):
                device.sendto(frames(n, n + 1), ("127.0.0.1", port))
            await until(here.status("live"), "it streams again")
            await until(lambda: here.samples == 20, "all that came is there")
            assert here.bytes == frames(0, 10) + frames(15, 25)
            await until(lambda: here.health.lost == 5, "what did not come is counted")


async def test_noise_after_a_silence_is_reported() -> None:
    """A device that restarts is silent first; if it then sends at another rate, that must not count as silence."""
    with pty() as port:
        async with stage(f"serial://{port.path}?baud=115200") as here:
            await until(lambda: "is open" in here.info.message, "it is opened")
            port.write(frames(0, 40))
            await until(here.status("live"), "it streams")
            await until(lambda: "No data" in here.info.message, "its silence is told")

            def is_reported() -> bool:
                port.write(bytes([0x55, 0x91, 0x0B]) * 4)
                return "none could be decoded" in here.info.message

            await until(is_reported, "the noise is told")
            assert "rate" in notice_of(here.info)[1]
            port.write(frames(40, 80))
            await until(here.status("live"), "it streams again")


@each_row("known", [True, False])
async def test_a_device_that_changes_its_rate_by_itself(known: bool) -> None:
    """The bytes are then endless noise, reported as such; if no rate was given, the new one is found."""
    with device(115_200) as bench:
        source = f"serial://{bench.slave}" + "?baud=115200" * known
        async with stage(source) as here:
            await until(here.status("live"), "it streams")
            assert bench.device is not None
            bench.device.baud = 460_800
            await until(lambda: "none could be decoded" in here.info.message, "it is told")
            assert "rate" in notice_of(here.info)[1]
            if not known:
                await until(here.status("live"), "it is found at the new rate")
                assert here.info.baud == 460_800
                return
            bench.device.baud = 115_200
            await until(here.status("live"), "it is read again without being opened anew")


async def test_a_retry_is_reported_once() -> None:
    """Regression: the retry was reported by the link and by the session."""
    async with stage("tcp://127.0.0.1:1") as there:
        await until(lambda: there.info.next_attempt, "it was tried")
        assert [one.what for one in there.info.attempts] == ["127.0.0.1:1"]
