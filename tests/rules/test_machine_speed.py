"""No test depends on how fast the machine is: what reads a clock, waits, or sets a limit is listed, with its reason.

A test waits for a condition (waiting.py and chromium.py of tests/support) or on a clock that it turns (virtual_time.py
and manual_clock.py there). A fixed wait is too long where all is well and too short on a busy machine; a limit of
seconds says nothing about the product; growth is counted in calls, bytes or operations. tests/bench measures speed.

    clock    time.time, monotonic, perf_counter, process_time, thread_time
    wait     time.sleep, asyncio.sleep; not a turn for others (TURN_S), nor in files of virtual time
    limit    a number below PATIENCE_S where a wait ends: timeout=, wait(), join(), result(), asyncio.timeout()
"""

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tests.support.each_row import each_row
from tests.support.source_files import ROOT, python_files, text_of, tree_of
from tests.support.timeouts import PATIENCE_S

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
        {"clock": 4, "wait": 17},
        "pictures for the guide, taken by hand of a page that runs",
    ),
    "browser/test_messages.py": ({"clock": 2}, STAMPS),
    "browser/test_scene.py": ({"limit": 1}, PACE),
    "check.py": ({"clock": 2}, "the time of each part is reported"),
    "support/chromium.py": ({"clock": 2, "wait": 1}, "the end of patience; a look now and then"),
    "fault_injection/ending.py": ({"clock": 2}, "the time an end took is reported"),
    "fault_injection/watched_server.py": ({"clock": 2, "wait": 1}, "processor time of the server between two beats"),
    "server/extensions/shares/test_relay_kernel.py": (
        {"clock": 2},
        "the relay runs until a time; stamps lie before now",
    ),
    "server/extensions/ros2/test_ros2_promised_names.py": (
        {"wait": 1},
        "a wait for a name, which the server's clock ends",
    ),
    "server/library/test_foreign_files.py": ({"wait": 2}, "a call that does not end; calls that have begun"),
    "fault_injection/test_links.py": (
        {"clock": 2, "wait": 1},
        "the server's own process stands still; time is counted beside what it reports",
    ),
    "fault_injection/test_restarts.py": ({"clock": 1}, STAMPS),
    "fuzz/__main__.py": ({"clock": 7}, BY_HAND),
    "fuzz/external_inputs.py": ({"clock": 3}, BY_HAND),
    "server/links/message_sources.py": (
        {"clock": 3},
        f"{PACE}; {STAMPS}",
    ),
    "server/links/test_capture_file.py": ({"clock": 2, "wait": 2}, "a file is read ahead, and nothing tells how far"),
    "server/links/test_foxglove.py": ({"clock": 5}, STAMPS),
    "server/extensions/shares/test_shared_port_link.py": (
        {"clock": 4, "wait": 1, "limit": 1},
        f"a holder that is quiet for a time of its own process; {PACE}",
    ),
    "server/extensions/shares/test_shared_port_link_clients.py": (
        {"clock": 6},
        "a client that is quiet for a time of its holder",
    ),
    "server/links/test_tcp_and_udp.py": ({"wait": 2}, "a host that never answers; a reading thread that is held up"),
    "server/links/test_read_loop.py": ({"clock": 5}, "a wait lasts at least as long as was asked for"),
    "server/links/test_replay.py": ({"wait": 1}, "the second device is opened later"),
    "server/extensions/ros2/test_link.py": ({"clock": 3}, STAMPS),
    "server/links/test_serial.py": (
        {"clock": 2, "wait": 1},
        "the pace of a reader; stamps lie between two readings of the clock",
    ),
    "server/links/test_simulated_line.py": ({"clock": 2}, "processor time of this thread, with a wide margin"),
    "server/links/test_simulator.py": (
        {"clock": 1, "wait": 4},
        "a reader that is late, a port that opens slowly, a plug that is out",
    ),
    "support/load_clients.py": ({"clock": 4, "wait": 2}, "clients of the benchmarks"),
    "protocols/test_floods.py": (
        {"clock": 2},
        "processor time of this thread; the limit is four times from what it tells apart",
    ),
    "web/record_wire.py": (
        {"clock": 2, "wait": 5},
        "what is recorded for the page's tests holds figures of some seconds",
    ),
    "recordings/mcap/test_live_writer.py": (
        {"clock": 1},
        STAMPS,
    ),
    "server/extensions/fleet/store/test_compact.py": ({"clock": 2}, AGE),
    "server/extensions/fleet/tunnel/test_http_tunnel_protocol.py": (
        {"limit": 2},
        "a wait that must not end, looked at for a moment",
    ),
    "whole/test_backward_compatibility.py": ({"clock": 2}, AGE),
    "server/extensions/alarms/test_alarm_file.py": (
        {"wait": 1},
        "what would overtake a write has the time to do so",
    ),
    "server/extensions/fleet/server/test_fleet_alarms.py": (
        {"wait": 1},
        "what would overtake a write has the time to do so",
    ),
    "server/test_resource_limits.py": ({"clock": 2}, "processor time, of work that took minutes"),
    "server/devices/link/test_byte_memory.py": ({"clock": 2}, "the memory of bytes is kept by the clock"),
    "server/streaming/test_clients.py": ({"wait": 1}, "a pause in which nothing is published"),
    "server/configuration/test_device_controller.py": ({"wait": 1}, "the pace of a device"),
    "server/extensions/foxglove/test_foxglove.py": ({"clock": 1}, TODAY),
    "server/api/test_websocket_load.py": ({"clock": 4}, "the rate limit of the server is by its clock"),
    "server/library/test_recorder_messages.py": ({"clock": 1}, STAMPS),
    "server/diagnostics/test_metrics.py": ({"clock": 1}, TODAY),
    "server/extensions/rerun/test_rerun.py": (
        {"limit": 1, "wait": 1},
        "the pace of a device; a wait that must not end",
    ),
    "whole/test_python_library.py": ({"limit": 1}, "a wait that must end without a sample"),
    "server/extensions/ros2/test_ros2.py": ({"clock": 2}, TODAY),
    "server/commands/test_simulate.py": ({"wait": 2}, "a device sends while nobody reads it"),
    "server/configuration/test_settings_diff.py": ({"wait": 1}, "the device's up-time goes on"),
    "server/api/test_websocket.py": ({"clock": 5, "limit": 1}, "the end of patience; a stamp is of today"),
    "support/server_process.py": ({"clock": 2, "wait": 1}, "the end of patience; a look now and then"),
    "server/extensions/fleet/synthetic_fleet.py": ({"clock": 1, "wait": 1}, "a fleet for benchmarks"),
    "support/waiting.py": ({"clock": 7, "wait": 2}, "the end of patience; a look now and then, that costs little"),
    "web/wire_scenes.py": ({"clock": 2, "limit": 2}, PACE),
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
    wrong, observed = [], set()
    for path in python_files("tests"):
        inside = path.relative_to(ROOT / "tests")
        if inside.parts[0] in NOT_CHECKED:
            continue
        results = list(findings(path))
        listed, reason = LISTED.get(str(inside), ({}, ""))
        observed |= {str(inside)} if results else set()
        counts = Counter(kind for kind, _ in results)
        wrong += [
            f"tests/{inside}:{line}: {kind}; {counts[kind]} there, {listed.get(kind, 0)} listed. {reason}".rstrip()
            for kind, line in results
            if counts[kind] != listed.get(kind, 0)
        ]
    assert not wrong, "\n".join([*wrong, "Wait for a condition, turn a clock, or count; what is gone leaves the list."])
    assert LISTED.keys() <= observed, f"no longer needed in the list: {sorted(LISTED.keys() - observed)}"


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
    assert [result for result, _ in findings(path)] == ([kind] if kind else [])
