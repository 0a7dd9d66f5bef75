"""No test depends on how fast the machine is: what reads a clock, waits, or sets a limit is listed, with its reason.

A test waits for a condition (tests/waiting.py, tests/chromium.py) or on a clock that it turns (tests/virtual_time.py,
tests/manual_clock.py). A fixed wait is too long where all is well and too short on a busy machine; a limit of seconds
says nothing about the product; growth is counted in calls, bytes or operations. Speed is measured in tests/bench.

    clock    time.time, monotonic, perf_counter, process_time, thread_time
    wait     time.sleep, asyncio.sleep; not a turn for others (TURN_S), nor in files of virtual time
    limit    a number below PATIENCE_S where a wait ends: timeout=, wait(), join(), result(), asyncio.timeout()
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tests.each_row import each_row
from tests.source_files import ROOT, python_files, text_of, tree_of
from tests.timeouts import PATIENCE_S

NOT_CHECKED = ("bench", "interop", "checking")  # they measure, or are run by hand
CLOCKS = {
    "time",
    "time_ns",
    "monotonic",
    "monotonic_ns",
    "perf_counter",
    "perf_counter_ns",
    "process_time",
    "thread_time",
}
TURN_S = 0.01  # so short a wait lets others go on, and nothing is concluded from it
LIMITED = {"wait", "join", "result", "timeout"}  # methods whose first argument is a time limit
KEYWORDS = {"timeout", "timeout_s"}
SUSPECT = re.compile(
    rf"time\.|sleep\(|(?:{'|'.join(LIMITED)})\([\d.]|(?:{'|'.join(KEYWORDS)})=[\d.]"
)  # else not parsed

STAMPS = "messages carry the time of now, which no assertion measures"
BY_HAND = "fuzzing by hand lasts as long as was asked for"
TODAY = "a stamp is of today, not of 1970"
AGE = "the age of a file"
PACE = "the pace of a sender"
LISTED: dict[str, tuple[dict[str, int], str]] = {
    "browser/guide_pictures.py": (
        {"clock": 6, "wait": 18},
        "pictures for the guide, taken by hand of a page that runs",
    ),
    "browser/test_messages.py": ({"clock": 2}, STAMPS),
    "browser/test_scene.py": ({"limit": 1}, PACE),
    "check.py": ({"clock": 2}, "the time of each part is reported"),
    "chromium.py": ({"clock": 2, "wait": 1}, "the end of patience; a look now and then"),
    "fault_injection/ending.py": ({"clock": 2}, "the time an end took is reported"),
    "fault_injection/watched_server.py": ({"clock": 2, "wait": 1}, "processor time of the server between two beats"),
    "extensions/shares/test_relay.py": ({"clock": 2}, "the relay runs until a time; stamps lie before now"),
    "extensions/ros2/test_promised_names.py": ({"wait": 1}, "a wait for a name, which the server's clock ends"),
    "server/test_foreign_files.py": ({"wait": 2}, "a call that does not end; calls that have begun"),
    "fault_injection/test_links.py": (
        {"clock": 2, "wait": 1},
        "the server's own process stands still; time is counted beside what it reports",
    ),
    "fault_injection/test_restarts.py": ({"clock": 1}, STAMPS),
    "fuzz/__main__.py": ({"clock": 7}, BY_HAND),
    "fuzz/external_inputs.py": ({"clock": 3}, BY_HAND),
    "links/message_sources.py": (
        {"clock": 3},
        f"{PACE}; {STAMPS}",
    ),
    "links/test_capture_file.py": ({"clock": 2, "wait": 2}, "a file is read ahead, and nothing tells how far"),
    "links/test_foxglove_source.py": ({"clock": 5}, STAMPS),
    "extensions/shares/test_held.py": (
        {"clock": 4, "wait": 1, "limit": 1},
        f"a holder that is quiet for a time of its own process; {PACE}",
    ),
    "extensions/shares/test_held_clients.py": (
        {"clock": 6},
        "a client that is quiet for a time of its holder",
    ),
    "links/test_network.py": ({"wait": 2}, "a host that never answers; a reading thread that is held up"),
    "links/test_read_loop.py": ({"clock": 5}, "a wait lasts at least as long as was asked for"),
    "links/test_replay.py": ({"wait": 1}, "the second device is opened later"),
    "extensions/ros2/test_ros2_source.py": ({"clock": 3}, STAMPS),
    "links/test_serial.py": (
        {"clock": 2, "wait": 2},
        "the event loop is busy with something else; stamps lie between two readings of the clock",
    ),
    "links/test_simulated_line.py": ({"clock": 2}, "processor time of this thread, with a wide margin"),
    "links/test_simulator.py": (
        {"clock": 1, "wait": 4},
        "a reader that is late, a port that opens slowly, a plug that is out",
    ),
    "load_clients.py": ({"clock": 4, "wait": 2}, "clients of the benchmarks"),
    "protocols/test_floods.py": (
        {"clock": 2},
        "processor time of this thread; the limit is four times from what it tells apart",
    ),
    "record_wire.py": ({"clock": 2, "wait": 5}, "what is recorded for the page's tests holds figures of some seconds"),
    "recordings/test_recording_writer.py": (
        {"clock": 1},
        STAMPS,
    ),
    "extensions/fleet/test_compact.py": ({"clock": 2}, AGE),
    "extensions/fleet/test_page_streams.py": ({"limit": 2}, "a wait that must not end, looked at for a moment"),
    "server/test_backward_compatibility.py": ({"clock": 2}, AGE),
    "extensions/alarms/test_alarms_while_saving.py": (
        {"wait": 1},
        "what would overtake a write has the time to do so",
    ),
    "extensions/fleet/test_fleet_alarms.py": ({"wait": 1}, "what would overtake a write has the time to do so"),
    "server/test_resource_limits.py": ({"clock": 2}, "processor time, of work that took minutes"),
    "server/test_byte_memory.py": ({"clock": 3}, "the memory of bytes is kept by the clock"),
    "server/test_clients.py": ({"wait": 1}, "a pause in which nothing is published"),
    "server/test_control.py": ({"wait": 1}, "the pace of a device"),
    "extensions/foxglove/test_foxglove.py": ({"clock": 1}, TODAY),
    "server/test_load.py": ({"clock": 4}, "the rate limit of the server is by its clock"),
    "server/test_message_recording.py": ({"clock": 1}, STAMPS),
    "server/test_metrics.py": ({"clock": 1}, TODAY),
    "extensions/rerun/test_rerun.py": ({"limit": 1, "wait": 1}, "the pace of a device; a wait that must not end"),
    "test_python_library.py": ({"limit": 1}, "a wait that must end without a sample"),
    "extensions/ros2/test_ros2.py": ({"clock": 2}, TODAY),
    "server/test_simulate.py": ({"wait": 2}, "a device sends while nobody reads it"),
    "server/test_settings_diff.py": ({"wait": 1}, "the device's up-time goes on"),
    "server/test_stream.py": ({"clock": 5, "limit": 1}, "the end of patience; a stamp is of today"),
    "server_process.py": ({"clock": 2, "wait": 1}, "the end of patience; a look now and then"),
    "extensions/fleet/synthetic_fleet.py": ({"clock": 1, "wait": 1}, "a fleet for benchmarks"),
    "waiting.py": ({"clock": 7, "wait": 2}, "the end of patience; a look now and then, that costs little"),
    "wire_scenes.py": ({"clock": 2, "limit": 2}, PACE),
}


def findings(path: Path) -> Iterator[tuple[str, int]]:
    """What depends on time in a file: its kind and line."""
    is_virtual = "virtual_time" in text_of(path)
    if not SUSPECT.search(text_of(path)):
        return
    for node in ast.walk(tree_of(path)):
        match node:
            case ast.Call(func=ast.Attribute(value=ast.Name(id="time"), attr=name)) if name in CLOCKS:
                yield "clock", node.lineno
            case ast.Call(func=ast.Attribute(value=ast.Name(id="time" | "asyncio"), attr="sleep"), args=[wait]):
                if not is_virtual and not (isinstance(wait, ast.Constant) and wait.value <= TURN_S):
                    yield "wait", node.lineno
            case ast.Call(func=ast.Attribute(attr=name), args=[limit, *_]) if name in LIMITED and _is_short(limit):
                yield "limit", node.lineno
            case ast.keyword(arg=name, value=limit) if name in KEYWORDS and _is_short(limit):
                yield "limit", limit.lineno


def _is_short(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float) and 0 < node.value < PATIENCE_S


def test_nothing_depends_on_the_speed_of_the_machine() -> None:
    wrong, seen = [], set()
    for path in python_files("tests"):
        inside = path.relative_to(ROOT / "tests")
        if inside.parts[0] in NOT_CHECKED:
            continue
        found = list(findings(path))
        listed, reason = LISTED.get(str(inside), ({}, ""))
        seen |= {str(inside)} if found else set()
        counts = Counter(kind for kind, _ in found)
        wrong += [
            f"tests/{inside}:{line}: {kind}; {counts[kind]} there, {listed.get(kind, 0)} listed. {reason}".rstrip()
            for kind, line in found
            if counts[kind] != listed.get(kind, 0)
        ]
    assert not wrong, "\n".join([*wrong, "Wait for a condition, turn a clock, or count; what is gone leaves the list."])
    assert LISTED.keys() <= seen, f"no longer needed in the list: {sorted(LISTED.keys() - seen)}"


@each_row(
    ("line", "kind"),
    [
        ("time.sleep(0.5)", "wait"),
        ("await asyncio.sleep(A_WHILE_S)", "wait"),
        ("await asyncio.sleep(0)", None),
        ("began = time.monotonic()", "clock"),
        ("writer = RecordingWriter(path, time.time_ns)", None),  # the product has a clock
        ("thread.join(5)", "limit"),
        ("thread.join(PATIENCE_S)", None),
        ("', '.join(names)", None),
        ("get(url, timeout=2.0)", "limit"),
        ("get(url, timeout=120)", None),
        ("async with asyncio.timeout(3): pass", "limit"),
    ],
)
def test_what_depends_on_time_is_found(line: str, kind: str | None, tmp_path: Path) -> None:
    path = tmp_path / "one.py"
    path.write_text(f"async def test():\n    {line}\n")
    assert [found for found, _ in findings(path)] == ([kind] if kind else [])
