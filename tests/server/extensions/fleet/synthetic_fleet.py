"""A made-up fleet for pages, pictures and benchmarks: robots whose figures wobble, and some in each kind of trouble.

    python -m tests.server.extensions.fleet.synthetic_fleet --robots 1000     serves its page until interrupted

`RobotMaker(count)` makes the same robots each time; `changed()` gives all of them a second later.
"""

from __future__ import annotations

import argparse
import random
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from imuscope.server.extensions.fleet.model.reports import RobotDevice
from imuscope.server.extensions.fleet.model.robots import Robots
from imuscope.server.extensions.fleet.model.summaries import RobotAlarm, RobotSummary
from imuscope.server.settings.config import Config
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer

SITES = ("Harbour", "Warehouse 3", "Orchard", "Test track")
PRODUCTS = (
    ("MTi-680G RTK GNSS/INS", "xbus", 400.0, ("1.12.0", "1.10.2")),
    ("MTi-630 AHRS", "xbus", 100.0, ("1.12.0", "1.8.1")),
    ("IMX-5", "isb", 250.0, ("2.5.1", "2.3.0")),
)
ALARMS = (("Strong vibration", "warning"), ("Overheated", "error"), ("Acceleration beyond 3 g", "warning"))


class RobotMaker:
    """Robots of a made-up fleet.

    Args:
        count: number of robots.
        now: unix s of their server.
    """

    def __init__(self, count: int, now: float | None = None, seed: int = 1) -> None:
        self._random = random.Random(seed)
        self._now = time.time() if now is None else now
        self.robots = [self._robot(i) for i in range(count)]

    def changed(self) -> list[RobotSummary]:
        """The robots a second later: each live one has other figures."""
        self._now += 1
        self.robots = [self._later(one) for one in self.robots]
        return self.robots

    def _robot(self, index: int) -> RobotSummary:
        chance = self._random.random
        is_lost = chance() < 0.012
        devices = [self._device(index, number) for number in range(2 if index % 9 == 4 else 1)]
        alarm = chance()
        drifted = self._random.randint(1, 4) if chance() < 0.03 else 0
        return RobotSummary(
            name=f"amr-{index + 1:03d}",
            group=SITES[index * len(SITES) // 1000 % len(SITES)] if index < 1000 else SITES[index % len(SITES)],
            state="lost" if is_lost else "live",
            since=self._now - self._random.uniform(30, 3600 if is_lost else 400_000),
            latency_ms=self._random.uniform(8, 90),
            version="1.0.0" if chance() < 0.9 else "0.9.4",
            address=f"http://amr-{index + 1:03d}.example:8080/",
            pages="view",
            recording=chance() < 0.3,
            disk_free_bytes=int(
                self._random.uniform(0.5e9, 6e9) if chance() < 0.03 else self._random.uniform(2e10, 4e11)
            ),
            settings="drifted" if drifted else "as-profile",
            drifted=drifted,
            alarms=[self._alarm(devices[0].id)] if alarm < 0.02 else [],
            devices=devices,
        )

    def _alarm(self, device: str) -> RobotAlarm:
        name, level = self._random.choice(ALARMS)
        state = "acknowledged" if self._random.random() < 0.3 else "raised"
        return RobotAlarm.model_validate({"name": name, "level": level, "state": state, "device": device})

    def _device(self, index: int, number: int) -> RobotDevice:
        chance = self._random.random
        product, protocol, rate, firmware = PRODUCTS[(index + number) % len(PRODUCTS)]
        has_receiver = "GNSS" in product or protocol == "isb"
        is_losing = chance() < 0.025
        return RobotDevice(
            id=str(number + 1),
            name=product.split(" ", maxsplit=1)[0],
            product=product,
            serial_number=f"0{37_000_000 + 17 * index + number}",
            firmware=firmware[0] if chance() < 0.85 else firmware[1],
            protocol=protocol,
            status="live",
            rate=rate * (0.7 if chance() < 0.01 else 1.0),
            expected_rate=rate,
            loss=self._random.uniform(0.0005, 0.06) if is_losing else 0.0,
            lost=self._random.randint(40, 9000) if is_losing else 0,
            fix=("no fix" if chance() < 0.02 else self._random.choice(("3D", "RTK fixed"))) if has_receiver else "",
            temperature=self._random.uniform(24, 48),
            clock_ppm=self._random.uniform(-18, 18),
            clock_uncertainty_ms=self._random.uniform(0.05, 0.6),
        )

    def _later(self, one: RobotSummary) -> RobotSummary:
        if one.state == "lost":
            if self._random.random() > 0.02:
                return one
            return one.model_copy(update={"state": "live", "since": self._now})
        if self._random.random() < 0.0003:
            return one.model_copy(update={"state": "lost", "since": self._now})
        wobble = self._random.gauss
        devices = [
            replace(
                device,
                rate=max(0.0, device.rate * wobble(1, 0.02))
                if device.rate < 0.95 * (device.expected_rate or 0)
                else (device.expected_rate or 0) * wobble(1, 0.012),
                temperature=(device.temperature or 0) + wobble(0, 0.6),
                lost=device.lost + (self._random.randint(0, 3) if device.loss else 0),
                loss=device.loss and min(0.2, max(1e-4, device.loss * wobble(1, 0.2))),
            )
            for device in one.devices
        ]
        return one.model_copy(
            update={"devices": devices, "latency_ms": max(4.0, (one.latency_ms or 30) * wobble(1, 0.3))}
        )


class SyntheticFleet:
    """A fleet server with made-up robots: `with SyntheticFleet(40) as fleet:`, then `fleet.change()`."""

    def __init__(self, count: int, folder: Path) -> None:
        self.robots = Robots()
        self.maker = RobotMaker(count)
        self.server = InProcessServer(
            Config(data=folder, sources=("fake",)), FakeLink, brought=[self.robots], has_devices=False
        )
        self.url = f"{self.server.url}/"
        self.publish(self.maker.robots)

    def publish(self, robots: list[RobotSummary]) -> None:
        """Robots with other figures."""
        self.server.call(lambda: [self.robots.update(one) for one in robots])

    def change(self) -> None:
        """Let all robots be a second later."""
        self.publish(self.maker.changed())

    def __enter__(self) -> SyntheticFleet:
        return self

    def __exit__(self, *error: object) -> None:
        self.server.__exit__(None, None, None)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="Serve the page of a made-up fleet.")
    parser.add_argument("--robots", type=int, default=1000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, SyntheticFleet(options.robots, Path(folder)) as fleet:
        print(fleet.url, flush=True)
        while True:
            time.sleep(1)
            fleet.change()


if __name__ == "__main__":
    main()
