"""Pictures of the pages of a failed browser test, their consoles, and the logs of its servers, to be looked at.

artifacts/failures/NAME-OF-THE-TEST.png, …-1.png    the pages that were open
                                   .txt             consoles and servers
"""

from __future__ import annotations

import re
from collections.abc import Generator
from contextlib import suppress
from typing import Any

import pytest
from playwright.sync_api import Error

from tests.conftest import ARTIFACTS
from tests.support import browser_engine, server_process

FOLDER = ARTIFACTS / "failures"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[Any]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Keep them while pages and servers are still there, and name the files in the report."""
    report = yield
    if call.when != "teardown" and report.failed:
        report.sections.append(("Kept of this failure", "\n".join(_keep(re.sub(r"\W+", "-", item.name).strip("-")))))
    return report


def _keep(name: str) -> list[str]:
    FOLDER.mkdir(parents=True, exist_ok=True)
    entries = []
    for number, page in enumerate(browser_engine.pages()):
        path = FOLDER / f"{name}{f'-{number}' if number else ''}.png"
        with suppress(Error):  # one that is closing, or that draws for too long
            page.screenshot(path=path)
            entries.append(f"{path} ({page.url})")
    logs = [f"── {one.url}\n{one.log}" for one in server_process.begun_last]
    path = FOLDER / f"{name}.txt"
    path.write_text("\n".join(["── consoles", *browser_engine.console, *logs]), encoding="utf-8")
    return [*entries, str(path)]
