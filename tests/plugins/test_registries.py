"""An exporter, a reader, a link and an analysis in a separate package, without a line of imuscope about them."""

import json
import os
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.recordings.exporters.registry import ExportFormat, register_exporter
from imuscope.server.links.registry import LinkDefinition, link_kinds, register_link
from tests.support.forking import fork_server
from tests.support.forking.fork_server import ForkServer
from tests.support.server_process import ServerProcess, imuscope
from tests.support.source_files import ROOT
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

FRAMES = PROTOCOLS["xbus"].frames.sample
EXPORTER = """
from imuscope.plugin import ExportFormat, register_exporter

def write(wish, out, step):
    out.write_text("".join(f"{info['name']}\\n" for info in wish.infos))
    step(1.0)
    return [out]

register_exporter(ExportFormat("names", "Names", ".names", write, words="names of the channels"))
"""
READER = (ROOT / "docs/add-a-reader.md").read_text().split("```python\n")[1].partition("```")[0]
ANALYSIS = """
from imuscope.plugin import Analysis, AnalysisOption, register_analysis

def run(signal, options):
    above = signal.values > options["level"]
    return {"share": float(above.mean()), "first": [float(signal.time[0])]}

register_analysis(
    Analysis(
        "above", "Above", "share of the samples above a level", run, {"first": "s"},
        (AnalysisOption("level", 0.0, -1e9, 1e9, doc="Level that is exceeded."),),
    )
)
"""
LINK = """
import asyncio
from imuscope.plugin import Chunk, Link, LinkError
from imuscope.plugin import LinkDefinition, link_kinds, register_link

class RepeatLink(Link):
    kind = "repeat"

    def __init__(self, source, settings, data):
        super().__init__(source, settings)
        self.data = data

    async def open(self, progress=None):
        pass

    async def read(self):
        await asyncio.sleep(0.02)
        return [Chunk(self.data, self.settings.now_ns())]

    async def write(self, data):
        raise LinkError("refused", "Nobody listens.")

    async def close(self):
        pass

def open_repeat(source, settings, parsed):
    parsed.allow(())
    return RepeatLink(source, settings, bytes.fromhex(parsed.place))

register_link(
    LinkDefinition(
        "repeat", "The same again", open_repeat, "repeat:HEX",
        usage=(("repeat:HEX", "the same bytes, over and over"),),
        examples=lambda: [("repeat:00", "a zero, over and over")],
    )
)
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A package on the path of processes that are started, as pip installs one."""
    folder = tmp_path_factory.mktemp("site")
    about = folder / "imuscope_more-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: imuscope-more\nVersion: 1\n")
    (about / "entry_points.txt").write_text(
        "[imuscope.exporters]\nnames = imuscope_names\n"
        "[imuscope.readers]\ntrip = imuscope_trip\n"
        "[imuscope.analyses]\nabove = imuscope_above\n"
        "[imuscope.links]\nrepeat = imuscope_repeat\nbroken = imuscope_gone\n"
    )
    (folder / "imuscope_names.py").write_text(EXPORTER)
    (folder / "imuscope_trip.py").write_text(READER)
    (folder / "imuscope_repeat.py").write_text(LINK)
    (folder / "imuscope_above.py").write_text(ANALYSIS)
    path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", path)
        yield


@pytest.fixture(scope="module")
def own(package: None) -> ForkServer | None:
    """Starts processes that find the package."""
    return ForkServer() if fork_server.IS_THERE else None


@pytest.fixture(scope="module")
def server(own: ForkServer | None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    with ServerProcess(
        f"repeat:{FRAMES.hex()}", data=tmp_path_factory.mktemp("data"), fresh=own is None, by=own
    ) as server:
        yield server


@pytest.fixture(scope="module")
def run(own: ForkServer | None) -> Callable[..., str]:
    """Output of `imuscope WORDS` in a new process that has found the package."""

    def run(*words: str) -> str:
        done = imuscope(*words, fresh=own is None, by=own)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


def test_every_command_reads_the_format_by_its_first_bytes(run: Callable[..., str], tmp_path: Path) -> None:
    log = tmp_path / "drive.unknown"
    log.write_text("TRIP\n1500000000 1.5\n1500000001 2.5\n")
    run("decode", str(log), "-o", str(tmp_path / "made.csv"))
    [made] = tmp_path.glob("made*.csv")
    assert "Speed" in made.read_text()
    assert "2.5" in made.read_text()


def test_the_command_line_lists_and_writes_the_format(run: Callable[..., str], tmp_path: Path) -> None:
    assert ".names (Names)" in " ".join(run("decode", "--help").split())
    capture = tmp_path / "capture.bin"
    capture.write_bytes(FRAMES * 50)
    run("decode", str(capture), "-o", str(tmp_path / "made.names"))
    assert "PacketCounter" in (tmp_path / "made.names").read_text().splitlines()


def test_the_command_line_lists_the_link(run: Callable[..., str]) -> None:
    shown = run("serve", "--help")
    assert "  repeat:HEX                      the same bytes, over and over\n" in shown


def test_the_server_offers_both_and_the_page_lists_them(server: ServerProcess) -> None:
    report = server.request("GET", "/api/capabilities")
    [names] = [one for one in report["exports"] if one["name"] == "names"]
    assert (names["title"], names["words"], names["single"]) == ("Names", "names of the channels", False)
    [repeat] = [one for one in report["links"] if one["name"] == "repeat"]
    assert repeat["examples"] == [{"source": "repeat:00", "words": "a zero, over and over"}]
    assert [one["name"] for one in report["exports"]][-1] == "names", "behind those that come with imuscope"


def test_the_command_line_lists_and_runs_the_analysis(run: Callable[..., str], tmp_path: Path) -> None:
    assert "  above                           share of the samples above a level\n" in run("analyse", "--help")
    capture = tmp_path / "capture.bin"
    capture.write_bytes(FRAMES * 50)
    words = ("analyse", str(capture), "above", "--signal", "PacketCounter", "--json", "--option")
    reports = [json.loads(run(*words, f"level={level}")) for level in (-1, 70_000)]
    assert [figures["share"] for report in reports for figures in report.values()] == [1.0, 0.0]


def test_the_server_runs_the_analysis(server: ServerProcess) -> None:
    assert [one["name"] for one in server.request("GET", "/api/analysis")] == [
        *("statistics", "histogram", "expression", "intervals", "psd", "spectrogram", "allan"),
        "above",
    ]
    block_until(lambda: server.request("GET", "/api/devices")[0]["status"] == "live", "a live device")
    body = json.dumps({"source": "1", "signals": ["PacketCounter"], "options": {"level": -1}}).encode()
    request = urllib.request.Request(
        f"{server.url.rstrip('/')}/api/analysis/above", body, {"content-type": "application/json"}
    )

    def figures() -> Any:
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
                return json.load(answer)
        except urllib.error.HTTPError:
            return None  # no samples yet

    [result] = block_until(figures, "figures of the live device")
    assert result["figures"]["share"] == 1.0
    assert result["units"] == {"first": "s"}


def test_a_device_is_live_over_the_link(server: ServerProcess) -> None:

    def device() -> Any:
        return next((one for one in server.request("GET", "/api/devices") if one["status"] == "live"), None)

    result = block_until(device, "a live device")
    assert (result["link"], result["protocol"]) == ("repeat", "xbus")


def test_unloadable_plugins_are_reported(server: ServerProcess) -> None:
    [message] = [line for line in server.lines if "imuscope_gone" in line]
    assert "The link 'broken' of imuscope-more 1 cannot be used" in message


def test_a_name_is_given_once() -> None:
    def nothing(*case: Any) -> Any:
        raise AssertionError

    assert {one.name for one in link_kinds()} >= {"serial", "udp"}
    with pytest.raises(ValueError, match="csv"):
        register_exporter(ExportFormat("csv", "", "", nothing))
    with pytest.raises(ValueError, match="udp"):
        register_link(LinkDefinition("udp", "", nothing, ""))
