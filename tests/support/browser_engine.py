"""One Chromium for all the browser tests of a process.

Playwright keeps an event loop running in the thread that started it, in which other tests could not run theirs. So it
is started when the first browser test asks, and ended before the next test of another kind (tests/conftest.py).
"""

from contextlib import ExitStack

from playwright.sync_api import Browser, Page, Playwright, sync_playwright

from tests.support import chromium

# A page of a test lives for seconds: to optimise its code takes longer than it saves, and so does a process for each.
ARGUMENTS = [*chromium.ARGUMENTS, "--js-flags=--no-turbofan,--no-maglev", "--renderer-process-limit=1"]

console: list[str] = []
"""What the pages of the running test have written to their consoles, for a report of its failure."""

_open = ExitStack()
_playwright: list[Playwright] = []
_browser: list[Browser] = []


def playwright() -> Playwright:
    """Playwright, running."""
    if not _playwright:
        _playwright.append(_open.enter_context(sync_playwright()))
    return _playwright[0]


def browser(path: str) -> Browser:
    """The one Chromium, started if it is not there, or not any more."""
    if not _browser or not _browser[0].is_connected():
        _browser[:] = [playwright().chromium.launch(executable_path=path, args=ARGUMENTS)]
    return _browser[0]


def pages() -> list[Page]:
    """All that are open."""
    return [page for one in _browser for context in one.contexts for page in context.pages]


def close() -> None:
    """End both, if they exist."""
    for one in _browser:
        one.close()
    _browser.clear()
    _open.close()
    _playwright.clear()
