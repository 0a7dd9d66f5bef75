"""Fixtures for every test: hypothesis profiles, captures, the real server, a real browser page.

    links      the links of a server that a test feeds (tests/support/fakes.py)
    captures   folder of device captures beside the project; the test is skipped, with the reason, where there is none
    serve      starts a server process: serve("sim:xbus") → ServerProcess with .url and .log; all are ended afterwards
    server     one such process with its default simulator, shared by the tests of a module
    open_page  opens a page in Chromium: open_page(url, width=…, dark=…) → playwright Page
    page       `server`'s page at 1440 × 900, dark

A page fails its test when anything is written to its console as an error, when a script throws, or when it asks any
other host for anything. Browser tests run last. Without a browser they fail in CI and are skipped by hand.

A test that is a coroutine runs in an event loop of its own.

Profiles: `fast` (default) draws the same examples each time, so a red run is a change; `deep` (HYPOTHESIS_PROFILE=deep)
draws new ones, many more.
"""

from __future__ import annotations

import inspect
import logging
import os
import sys
from collections import defaultdict
from collections.abc import Callable, Generator, Iterator
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers
from playwright.sync_api import Browser, ConsoleMessage, Page, Request, WebSocket

from imuscope.protocols.native import kernels as compiled
from imuscope.recordings.system import priority
from tests.checking import machine
from tests.checking.affected import durations
from tests.checking.forked_tests import unit_of
from tests.support import browser_engine, chromium, each_row, server_process
from tests.support.chromium import until
from tests.support.forking import fork_server, forked_workers
from tests.support.forking.fork_server import ForkServer
from tests.support.server_process import ROOT, ServerProcess
from tests.support.timeouts import PATIENCE_S

if TYPE_CHECKING:
    from tests.support.fakes import FakeLinks
    from tests.support.in_process_server import InProcessServer

ARTIFACTS = ROOT / "artifacts"
SHARED = ROOT.parent / "shared"
_test_numbers = count(1)
LOG_LINES = 40  # of a server, in the report of a test that failed

READY = """window.imuscope?.store.channels.value.some(channel => channel.ring.length > 20)
    && document.querySelector("[data-numeral]") !== null"""
"""In a page: samples have arrived and are shown."""

# Some environments forbid it, and every process of the tests would compile every module anew, 10 s of a processor.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

os.environ.setdefault(priority.SAME, "1")


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a test that is a coroutine."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    each_row.run_test(pyfuncitem.obj, {name: pyfuncitem.funcargs[name] for name in names})
    return True


def _use_nursery() -> None:
    server_process.nursery = ForkServer(os.environ.get(fork_server.VARIABLE, ""))
    forked_workers.install(server_process.nursery)


if fork_server.IS_THERE:
    _use_nursery()

SLOW = [HealthCheck.too_slow, HealthCheck.data_too_large]
settings.register_profile("fast", max_examples=30, deadline=None, derandomize=True, suppress_health_check=SLOW)
settings.register_profile("deep", max_examples=2000, deadline=None, print_blob=True, suppress_health_check=SLOW)
settings.load_profile(PROFILE := os.environ.get("HYPOTHESIS_PROFILE", "fast"))
if PROFILE == "fast":
    # Values that occur in the code are tried too, of all modules that happen to be imported: the examples of a test
    # would depend on the tests that ran before it in its worker, and a failure would not come again alone.
    providers._get_local_constants = providers.Constants


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--row", default="", help="only rows whose title contains this")


def pytest_configure(config: pytest.Config) -> None:
    """Require machine code of the very source that is tested."""
    each_row.only = config.getoption("row")
    from imuscope.protocols.registry import families as registry  # noqa: F401 (its modules have the functions)

    if not compiled.DISABLED and (names := compiled.missing()):
        command = "python -m imuscope.protocols.native.compiler"
        pytest.exit(f"{len(names)} functions have no machine code, {names[0]} first: {command}", returncode=3)


@pytest.hookimpl(optionalhook=True)
def pytest_before_workers() -> None:
    """Load once what each worker would load: what is known of the sources, and what servers are forked from."""
    from imuscope.server.library.decoder_fingerprint import decoding_mark

    decoding_mark()
    if fork_server.IS_THERE:
        fork_server.share()


@pytest.hookimpl(optionalhook=True)
def pytest_worker_begins() -> None:
    if fork_server.IS_THERE:
        _use_nursery()


@pytest.hookimpl(optionalhook=True)
def pytest_worker_ends() -> None:
    browser_engine.close()


@pytest.fixture(scope="session", autouse=True)
def shared_data_home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A default data folder of what several tests share that is not the one of the user who runs the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_DATA_HOME", str(tmp_path_factory.mktemp("home")))
        yield


@pytest.fixture(autouse=True)
def data_home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A default data folder of each test: a transaction that an earlier one interrupted opens its device in no later
    one. Made by whoever writes there.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_DATA_HOME", str(tmp_path_factory.getbasetemp() / f"home-{next(_test_numbers)}"))
        yield


@pytest.fixture(scope="session", autouse=True)
def patient_shutdown() -> Iterator[None]:
    """Services of a server in this process have as long as a loaded machine takes to close: what is abandoned would be
    found as a leaked process by a later test.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("imuscope.server.http.shutdown.PART_S", PATIENCE_S)
        yield


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first, as the last run had them: begun last, they would run on alone. The browser's last."""
    folder = Path(__file__).parent / "browser"
    seconds: defaultdict[Path, float] = defaultdict(float)
    for name, passed in durations().items():
        seconds[unit_of(ROOT / name)] += passed
    drives = {path: folder in path.parents for path in {item.path for item in items}}
    for item in items:
        if drives[item.path]:
            item.add_marker(pytest.mark.browser)
    items.sort(key=lambda item: (drives[item.path], -seconds[unit_of(item.path)]))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """What a failure needs besides its traceback: what the servers printed, and how busy the machine was."""
    report = yield
    if report.failed:
        for one in server_process.begun_last:
            report.sections.append((f"log of the server at {one.url}", "".join(one.lines[-LOG_LINES:])))
        report.sections.append(("state of the machine", machine.state()))
    return report


@pytest.fixture(scope="session")
def captures() -> Path:
    """Folder with one folder of device captures per protocol."""
    folder = SHARED / "captures"
    if not folder.is_dir():
        pytest.skip(f"no captures: {folder} is not there")
    return folder


@pytest.fixture
def links() -> FakeLinks:
    """Links of a server in this process, into which a test sends."""
    from tests.support.fakes import FakeLinks

    return FakeLinks()


@pytest.fixture
def running(tmp_path: Path, links: FakeLinks) -> Iterator[InProcessServer]:
    """A server in this process with two devices, into whose links a test sends."""
    from imuscope.server.settings.config import Config
    from tests.support.in_process_server import InProcessServer

    with InProcessServer(Config(sources=("/dev/one", "/dev/two"), data=tmp_path), links.open) as running:
        yield running


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., ServerProcess]]:
    """Start a server of the given sources and arguments."""
    yield from _serving(tmp_path)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server with its simulator, for the tests of one module."""
    for start in _serving(tmp_path_factory.mktemp("data")):
        yield start("sim:xbus")


def _serving(folder: Path) -> Iterator[Callable[..., ServerProcess]]:
    running: list[ServerProcess] = []

    def start(*sources: str, arguments: tuple[str, ...] = (), prefix: tuple[str, ...] = ()) -> ServerProcess:
        data = folder / f"data{len(running)}"
        running.append(ServerProcess(*sources, data=data, arguments=arguments, prefix=prefix))
        return running[-1]

    yield start
    for one in running:
        one.stop()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Chromium goes before a test that is not for it."""
    if item.get_closest_marker("browser") is None:
        browser_engine.close()


def pytest_sessionfinish() -> None:
    browser_engine.close()


def chromium_path() -> str:
    """The browser on this machine; without one the test is skipped, or fails where it must be there."""
    path = chromium.find()
    if path is None:
        reason = "no Chromium: install one, or name it in IMUSCOPE_CHROMIUM (tests/check.py tries to fetch one)"
        if os.environ.get("CI") or os.environ.get("IMUSCOPE_NEEDS_BROWSER"):
            pytest.fail(reason)
        pytest.skip(reason)
    return str(path)


@pytest.fixture
def browser() -> Browser:
    """The one Chromium of this process."""
    return browser_engine.browser(chromium_path())


@pytest.fixture
def open_page(browser: Browser) -> Iterator[Callable[..., Page]]:
    """Open a page, by default 1440 x 900 px, dark, without touch."""
    complaints: list[str] = []
    contexts = []
    browser_engine.console.clear()

    def start(
        url: str,
        *,
        width: int = 1440,
        height: int = 900,
        dark: bool = True,
        touch: bool = False,
        still: bool = False,
        scale: float = 1.0,
        before: str = "",
        first_minute: bool = False,
    ) -> Page:
        context = browser.new_context(
            viewport={"width": width, "height": height},
            color_scheme="dark" if dark else "light",
            has_touch=touch,
            is_mobile=touch,
            reduced_motion="reduce" if still else "no-preference",
            device_scale_factor=scale,
        )
        contexts.append(context)
        context.add_init_script(chromium.SLOW_SCREEN)
        if not first_minute:
            context.add_init_script(chromium.NOT_THE_FIRST_MINUTE)
        if before:
            context.add_init_script(before)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_S * 1000)
        watch(page, url, complaints)
        page.goto(url)
        return page

    yield start
    for context in contexts:
        context.close()
    assert not complaints, "\n".join(complaints)


@pytest.fixture(autouse=True)
def logging_as_before() -> Iterator[None]:
    """Levels and handlers of the log as they were: a command that ran within the test sets its own."""
    loggers = [logging.getLogger(name) for name in ("", "imuscope")]
    before = [(logger, logger.level, logger.handlers[:]) for logger in loggers]
    yield
    for logger, level, handlers in before:
        logger.setLevel(level)
        logger.handlers[:] = handlers


@pytest.fixture
def runtime(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The runtime folder of this test alone: nobody else's holder is found. Its path is short enough for a socket."""
    folder = tmp_path_factory.mktemp("run")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    return folder


@pytest.fixture
def page(open_page: Callable[..., Page], server: ServerProcess) -> Page:
    """The page of `server`, wide and dark, once samples are arriving."""
    page = open_page(server.url)
    until(page, READY)
    return page


def watch(page: Page, url: str, complaints: list[str]) -> None:
    """Note what may never happen: an error on the console, a script that throws, a request to another host."""
    home = urlsplit(url).netloc

    def question(request: Request) -> None:
        target = urlsplit(request.url)
        if target.scheme not in ("data", "blob") and target.netloc != home:
            complaints.append(f"asked another host: {request.url}")

    def complained(message: ConsoleMessage) -> None:
        browser_engine.console.append(f"{message.type}: {message.text}")
        # A server that goes down on purpose, and one that refuses a file or a question, is reported by the browser
        # itself, which no page can prevent.
        of = message.location.get("url", "")
        refused = "status of 422" in message.text and ("/api/recordings/upload" in of or of.endswith("/api/query"))
        if message.type == "error" and "ERR_CONNECTION_REFUSED" not in message.text and not refused:
            question = "status of 409" in message.text and message.location.get("url", "").endswith("/apply")
            # somebody else saved the workspace or the notes before, and the page offers what to do
            address = message.location.get("url", "")
            is_shared = "/api/workspaces/" in address or "/api/recordings/" in address
            changed = "status of 412" in message.text and is_shared
            gone = "status of 404" in message.text and "/api/analysis/" in address  # of what was just removed
            if (
                not question and not changed and not gone
            ):  # it needs confirmation before it writes, and the page shows the dialog
                complaints.append(f"console: {message.text} ({message.location.get('url', 'no address')})")

    def connected(socket: WebSocket) -> None:
        if urlsplit(socket.url).netloc != home:
            complaints.append(f"connected to another host: {socket.url}")

    page.on("console", complained)
    page.on("pageerror", lambda error: complaints.append(f"threw: {error}"))
    page.on("request", question)
    page.on("websocket", connected)
