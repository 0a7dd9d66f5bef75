"""Fixed waits in tests: each is listed with its reason, and none is added.

A test waits for a condition (tests/waiting.py), or on a clock that it moves (tests/virtual_time.py). A fixed wait is
too long where all is well and too short on a machine that is busy. Not counted: a look in a loop until something is so,
a turn of the event loop, and time that is virtual.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from tests.source_files import ROOT, python_files, text_of, tree_of

NOT_CHECKED = ("bench", "browser", "interop")  # they measure, have waits of their own, or are run by hand
TURN_S = 0.01  # so short a wait lets others go on, and nothing is concluded from it
FIXED: dict[str, tuple[int, str]] = {
    "fault_injection/test_links.py": (1, "the server's own process stands still"),
    "links/test_baud_scan.py": (1, "the plug is pulled at any moment of the search"),
    "links/test_capture_file.py": (2, "a file is read ahead, and nothing tells how far"),
    "links/test_network.py": (2, "a host that never answers; a reading thread that is held up"),
    "links/test_replay.py": (1, "the second device is opened later"),
    "links/test_serial.py": (1, "the event loop is busy with something else"),
    "links/test_simulator.py": (4, "a reader that is late, a port that opens slowly, a plug that is out"),
    "record_wire.py": (2, "what is recorded for the page's tests holds figures of some seconds"),
    "server/test_clients.py": (1, "a pause in which nothing is published"),
    "server/test_settings_diff.py": (1, "the device's up-time goes on"),
}


def fixed_waits(path: Path) -> Iterator[int]:
    """Lines that wait for a time that is written there."""

    def walk(node: ast.AST, *, in_loop: bool) -> Iterator[int]:
        match node:
            case ast.Call(func=ast.Attribute(value=ast.Name(id="time" | "asyncio"), attr="sleep"), args=[wait]):
                if not in_loop and not (isinstance(wait, ast.Constant) and wait.value <= TURN_S):
                    yield node.lineno
        for child in ast.iter_child_nodes(node):
            yield from walk(child, in_loop=in_loop or isinstance(node, ast.While))

    if "sleep(" in text_of(path):
        yield from walk(tree_of(path), in_loop=False)


def test_no_fixed_wait_is_added() -> None:
    found = {
        str(path.relative_to(ROOT / "tests")): list(fixed_waits(path))
        for path in python_files("tests")
        if path.relative_to(ROOT / "tests").parts[0] not in NOT_CHECKED and "virtual_time" not in text_of(path)
    }
    listed = {name: count for name, (count, _) in FIXED.items()}
    wrong = [
        f"tests/{name}: lines {lines} wait for a fixed time; {listed.get(name, 0)} are listed"
        for name, lines in found.items()
        if len(lines) != listed.get(name, 0)
    ]
    assert not wrong, "\n".join([*wrong, "Wait for a condition (tests/waiting.py), or take what is gone off the list."])
    assert listed.keys() <= found.keys()


def test_a_fixed_wait_is_found(tmp_path: Path) -> None:
    path = tmp_path / "one.py"
    path.write_text(
        "import asyncio, time\n"
        "time.sleep(0.5)\n"
        "def wait():\n"
        "    while not is_there():\n"
        "        time.sleep(0.5)\n"
        "async def turn():\n"
        "    await asyncio.sleep(0)\n"
        "    await asyncio.sleep(A_WHILE_S)\n"
    )
    assert list(fixed_waits(path)) == [2, 8]
