"""A fleet server on an unreliable bus: it has everything once, nothing twice, whatever is lost or repeated."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from imuscope.server.extensions.fleet.model import keys
from imuscope.server.extensions.fleet.model.journal import Journal
from imuscope.server.extensions.fleet.model.reports import RobotDevice, RobotEvent, RobotReport, RobotStatus, encode
from imuscope.server.extensions.fleet.model.robots import Robots
from imuscope.server.extensions.fleet.query import database as database_file
from imuscope.server.extensions.fleet.query.database import (
    FleetBatch,
    FleetDatabase,
    FleetDatabaseError,
    StoredEvent,
    StoredRobot,
)
from imuscope.server.extensions.fleet.server import collector as module
from imuscope.server.extensions.fleet.server.collector import REQUEST_INTERVAL_S, Collector

NAME = "otter-7"
KEY = keys.report_key(NAME)


class Bus:
    """A fleet server with one robot and a bus between them, of which the test says what arrives."""

    def __init__(self, folder: Path, journal_limit: int = 10**6) -> None:
        self.time = 1_700_000_000.0
        self.folder = folder
        self.limit = journal_limit
        self.made = 0
        self.journal = self.started_journal()
        self.start()

    def now(self) -> float:
        return self.time

    def close(self) -> None:
        self.database.close()
        self.journal.close()

    def start(self) -> None:
        self.database = FleetDatabase(self.folder)
        self.robots = Robots(now=self.now)
        self.collector = Collector(self.robots, self.database.robots(), self.now, last_number=self.database.last_number)

    def restart_server(self, *, is_killed: bool) -> None:
        if not is_killed:
            self.write()
        self.database.close()
        self.start()
        self.announce(alive=True)

    def started_journal(self) -> Journal:
        journal = Journal(self.limit, self.folder / "robot")
        journal.start()
        journal.wait_loaded()
        return journal

    def restart_robot(self, *, is_noticed: bool = True) -> None:
        """Restart it.

        Args:
            is_noticed: its token is withdrawn before; else after the next one has come.
        """
        before = self.journal
        if is_noticed:
            self.announce(alive=False)
        self.journal.close()
        self.journal = self.started_journal()
        self.announce(alive=True)
        if not is_noticed:
            self.collector.on_token(keys.token_key(NAME, before.boot), alive=False)

    def announce(self, *, alive: bool) -> None:
        self.collector.on_token(keys.token_key(NAME, self.journal.boot), alive=alive)

    def report(self, *, arrives: bool = True, repeated: bool = False) -> None:
        self.made += 1
        self.journal.add_event(RobotEvent(self.time, "marker", "info", str(self.made)))
        data = self.journal.report(self.time, RobotStatus(version=str(self.made)))
        for _ in range(arrives + repeated):
            self.collector.on_report(KEY, data)

    def request(self) -> int:
        """Journals that are asked for now; each answers."""
        requests = list(self.collector.questions(10))
        for name, boot, after, copy in requests:
            data = self.journal.answer(boot, after, 400, earlier=True, stored=copy)
            self.collector.on_journal(keys.journal_key(name), data)
        return len(requests)

    def catch_up(self) -> None:
        for _ in range(200):
            self.time += 1.0
            self.collector.on_report(KEY, self.journal.report(self.time, None))
            self.request()

    def write(self) -> None:
        batch = self.collector.taken_batch()
        self.database.write(batch)
        self.collector.written(batch)

    @property
    def events(self) -> list[str]:
        self.write()
        return [event.text for _, event in reversed(self.database.events(limit=10_000)) if event.kind == "marker"]


@pytest.fixture
def new_bus(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Bus]:
    """A bus that has announced its robot, with the limit of the journal that the test is given."""
    with closing(Bus(tmp_path, *getattr(request, "param", ()))) as bus:
        bus.announce(alive=True)
        yield bus


@pytest.fixture
def bus(new_bus: Bus) -> Bus:
    new_bus.request()
    return new_bus


@pytest.fixture
def database(tmp_path: Path) -> Iterator[FleetDatabase]:
    with closing(FleetDatabase(tmp_path)) as database:
        yield database


def test_events_are_pruned_by_a_server_that_is_started_often(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With fewer events in each run than between two prunings, the file grew without a limit."""
    monkeypatch.setattr(database_file, "MAX_EVENTS", 10)
    for _ in range(5):
        with closing(FleetDatabase(tmp_path)) as database:
            for _ in range(2):
                database.write(FleetBatch(events=[StoredEvent("a", "", 0, 0.0, "k", "info", "t", "")] * 8))
    with closing(FleetDatabase(tmp_path)) as database:
        assert len(database.events()) <= 10 + 8


def test_reports_that_overtake_the_first_answer_are_requested(new_bus: Bus) -> None:
    """Without a later report they were missing for minutes."""
    bus = new_bus
    bus.report()
    [(_, boot, after, copy)] = bus.collector.questions(10)
    answer = bus.journal.answer(boot, after, earlier=True, stored=copy)
    bus.report()
    bus.report()
    bus.collector.on_journal(keys.journal_key(NAME), answer)
    assert bus.events == ["1"]
    assert bus.request() == 1
    assert bus.events == ["1", "2", "3"]
    assert bus.request() == 0


def test_a_robot_comes_and_goes(bus: Bus) -> None:
    bus.report()
    robot = bus.robots.get(NAME)
    assert robot is not None
    assert (robot.state, robot.version, robot.since) == ("live", "1", bus.time)
    bus.time += 60
    bus.announce(alive=False)
    robot = bus.robots.get(NAME)
    assert robot is not None
    assert (robot.state, robot.version, robot.since) == ("lost", "1", bus.time)


def test_a_report_that_is_missing_is_requested(bus: Bus) -> None:
    bus.request()
    bus.report()
    bus.report(arrives=False)
    assert bus.request() == 0
    bus.report()
    assert bus.request() == 1
    bus.request()  # the first answer was full
    assert bus.events == ["1", "2", "3"]


def test_the_last_report_before_a_silence_is_requested(bus: Bus) -> None:
    bus.report(arrives=False)
    bus.catch_up()
    assert bus.events == ["1"]


def test_a_report_that_comes_twice_is_taken_once(bus: Bus) -> None:
    bus.report(repeated=True)
    assert bus.events == ["1"]
    assert bus.collector.counts.repeated == 1


@pytest.mark.parametrize("new_bus", [(400,)], indirect=True)
def test_what_a_robot_had_to_drop_is_counted(new_bus: Bus) -> None:
    bus = new_bus
    for _ in range(20):
        bus.report(arrives=False)
    bus.catch_up()
    stored = bus.events
    assert stored == [str(number) for number in range(21 - len(stored), 21)]
    assert bus.collector.counts.missed == bus.journal.dropped == 20 - len(stored)
    assert any("were dropped" in event.text for _, event in bus.database.events())


def test_a_restart_of_the_fleet_server_keeps_since_and_state(bus: Bus) -> None:
    came = bus.time
    bus.report()
    bus.time += 100
    bus.restart_server(is_killed=False)
    robot = bus.robots.get(NAME)
    assert robot is not None
    assert (robot.state, robot.since, robot.version) == ("live", came, "1")


def test_a_robot_that_left_during_a_restart_is_lost(bus: Bus) -> None:
    bus.report()
    bus.write()
    bus.database.close()
    bus.time += 100
    bus.start()
    bus.collector.settle_absent()
    robot = bus.robots.get(NAME)
    assert robot is not None
    assert (robot.state, robot.since) == ("lost", bus.time)


def status_of(serial_number: str) -> RobotStatus:
    return RobotStatus(devices=(RobotDevice("1", "MTi", "live", serial_number=serial_number),), pages="view")


def rows(bus: Bus) -> dict[str, tuple[str, int, str]]:
    """Serial number, number of other robots of the name, and rights at its pages, by row."""
    return {
        name: (one.devices[0].serial_number if one.devices else "", one.same_name, one.pages)
        for name, one in bus.robots.summaries.items()
    }


def test_two_robots_of_one_disk_image_were_one_row(bus: Bus, tmp_path: Path) -> None:
    bus.collector.on_report(KEY, bus.journal.report(bus.time, status_of("A")))
    second = Journal(10**6, tmp_path / "second")
    bus.collector.on_token(keys.token_key(NAME, second.boot), alive=True)
    bus.collector.on_report(KEY, second.report(bus.time, status_of("B")))
    assert rows(bus) == {NAME: ("B", 0, "view")}  # so far, the first one may have been restarted
    bus.collector.on_report(KEY, bus.journal.report(bus.time, None))
    assert rows(bus) == {NAME: ("B", 1, "view"), f"{NAME} (2)": ("A", 1, "off")}
    bus.collector.on_report(KEY, bus.journal.report(bus.time, status_of("A2")))
    assert rows(bus)[f"{NAME} (2)"] == ("A2", 1, "off")
    bus.write()
    (event,) = [event for _, event in bus.database.events() if event.level == "error"]
    assert event.text == (
        "Several robots call themselves otter-7. Give each its own name: imuscope serve … --fleet-name NAME."
    )
    bus.collector.on_token(keys.token_key(NAME, second.boot), alive=False)
    assert rows(bus) == {NAME: ("A2", 0, "view")}


def test_robots_of_one_name_leave_in_any_order(bus: Bus) -> None:
    boots = [bus.journal.boot, "b" * 16, "c" * 16]
    for boot in boots[1:]:
        bus.collector.on_token(keys.token_key(NAME, boot), alive=True)
    for boot in (*boots, *boots):
        bus.collector.on_report(KEY, encode(RobotReport(boot, 1, bus.time, status=status_of(boot[0]))))
    assert {name: (serial, n) for name, (serial, n, _) in rows(bus).items()} == {
        NAME: ("c", 2),
        f"{NAME} (2)": (boots[0][0], 2),
        f"{NAME} (3)": ("b", 2),
    }
    bus.collector.on_token(keys.token_key(NAME, boots[0]), alive=False)
    assert {name: (serial, n) for name, (serial, n, _) in rows(bus).items()} == {
        NAME: ("c", 1),
        f"{NAME} (2)": ("b", 1),
    }
    bus.collector.all_lost()
    assert list(rows(bus)) == [NAME]


def test_a_robot_whose_restart_was_not_noticed_is_one_row(bus: Bus) -> None:
    bus.report()
    bus.restart_robot(is_noticed=False)
    bus.catch_up()
    assert list(rows(bus)) == [NAME]
    bus.write()
    assert not [event for _, event in bus.database.events() if event.level == "error"]


steps = st.lists(
    st.sampled_from(
        ["arrives", "lost", "repeated", "ask", "write", "stopped", "killed", "line", "robot", "soon", "wait"]
    ),
    max_size=40,
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60, deadline=None)
@given(steps=steps)
def test_whatever_happens_everything_is_stored_once(steps: list[str], tmp_path_factory: pytest.TempPathFactory) -> None:
    bus = Bus(tmp_path_factory.mktemp("fleet"))
    bus.announce(alive=True)
    for step in steps:
        bus.time += 0.5
        match step:
            case "arrives" | "lost" | "repeated":
                bus.report(arrives=step != "lost", repeated=step == "repeated")
            case "ask":
                bus.request()
            case "write":
                bus.write()
            case "stopped" | "killed":
                bus.restart_server(is_killed=step == "killed")
            case "line":
                bus.announce(alive=False)
                bus.announce(alive=True)
            case "robot" | "soon":
                bus.restart_robot(is_noticed=step == "robot")
            case "wait":
                bus.time += 20
    bus.catch_up()
    assert bus.events == [str(number) for number in range(1, bus.made + 1)]
    assert bus.collector.counts.missed == 0
    bus.close()


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["token", "report", "journal"]),
            st.text(max_size=30) | st.sampled_from([KEY, keys.token_key(NAME, "a" * 16), f"{keys.ROBOTS}/*/report"]),
            st.binary(max_size=60),
        ),
        max_size=20,
    )
)
def test_nothing_from_the_bus_raises(messages: list[tuple[str, str, bytes]]) -> None:
    collector = Collector(Robots(limit=3), [])
    for kind, key, data in messages:
        if kind == "token":
            collector.on_token(key, alive=bool(data))
        else:
            (collector.on_report if kind == "report" else collector.on_journal)(key, data)
        list(collector.questions(10))


def test_a_clock_that_is_set_back_delays_no_question() -> None:
    """What a robot had reported while the line was away was missing for as long."""
    wall_s, steady_s = [1_700_000_000.0], [0.0]
    collector = Collector(Robots(), [], lambda: wall_s[0], clock=lambda: steady_s[0])
    collector.on_token(keys.token_key(NAME, "a" * 16), alive=True)
    for _ in range(2):
        assert len(list(collector.questions(10))) == 1
        wall_s[0] -= 3600
        steady_s[0] += REQUEST_INTERVAL_S


def test_names_and_runs_are_bounded() -> None:
    robots = Robots(limit=2)
    collector = Collector(robots, [])
    for number in range(10):
        collector.on_token(keys.token_key(f"robot-{number}", "a" * 16), alive=True)
        collector.on_token(keys.token_key("robot-0", f"{number:016x}"), alive=True)
    assert len(robots.summaries) == 2
    assert collector.live == 2
    assert collector.counts.refused == 8 + 10 - (module.MAX_BOOTS - 1)


def test_events_wait_with_the_robots_while_the_disk_is_full(bus: Bus, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_UNWRITTEN", 2)
    for _ in range(6):
        bus.report()
    assert len(bus.collector.batch.events) == 2
    for _ in range(10):
        bus.write()
        bus.catch_up()
    assert bus.events == ["1", "2", "3", "4", "5", "6"]


def test_a_batch_that_cannot_be_written_is_tried_again(bus: Bus) -> None:
    bus.report()
    batch = bus.collector.taken_batch()
    bus.report()
    bus.collector.give_back(batch)
    assert bus.events == ["1", "2"]


def test_a_batch_is_written_whole_or_not_at_all(database: FleetDatabase) -> None:
    event = StoredEvent("a", "", 1, 0.0, "link", "info", "text", "")
    broken = StoredEvent("a", "", 1, 0.0, "link", "info", object(), "")  # type: ignore[arg-type]
    with pytest.raises(FleetDatabaseError):
        database.write(FleetBatch(robots={"a": StoredRobot("a")}, events=[event, broken]))
    assert database.robots() == []
    assert database.events() == []


def test_the_log_of_events_is_bounded(database: FleetDatabase, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("imuscope.server.extensions.fleet.query.database.MAX_EVENTS", 10)
    monkeypatch.setattr("imuscope.server.extensions.fleet.query.database.PRUNE_EVERY", 5)
    for number in range(8):
        database.write(FleetBatch(events=[StoredEvent("a", "", number, 0.0, "link", "info", "t", "")] * 5))
    assert len(database.events()) == 10
    assert [event.number for _, event in database.events(before=36, limit=1)] == [6]


def test_a_robot_that_is_lost_can_be_removed(bus: Bus) -> None:
    assert not bus.collector.remove(NAME)
    bus.announce(alive=False)
    assert bus.collector.remove(NAME)
    bus.write()
    assert bus.database.robots() == []
    assert bus.robots.get(NAME) is None
