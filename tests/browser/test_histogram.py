"""The histogram in a real browser: live, of a recording against numpy, and on a phone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page

from tests.browser.test_page import DESKTOP, PHONE, TARGETS, opened, reload, serious
from tests.browser.test_recordings import ask, recorded
from tests.browser.test_recordings import opened as opened_recording
from tests.browser.test_xy import show
from tests.chromium import until
from tests.server_process import ServerProcess

__all__ = ["recorded"]  # a fixture

SOURCE = "sim:xbus?product=MTi-630&rate=100&seed=1"
PANEL = "document.querySelector('[data-panel=histogram]')"
OUTLINES = f"{PANEL}?.querySelectorAll('path.bins').length"
FIGURES = f"{PANEL}?.querySelector('tbody')?.innerText ?? ''"


def test_a_histogram_of_live_signals(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    page = opened(serve(SOURCE), open_page, DESKTOP)
    show(page, "Histogram")
    until(page, f"{OUTLINES} === 3")
    page.get_by_label("Quantity", exact=True).select_option(label="Acceleration (m/s²)")
    page.locator("[data-panel=histogram]").get_by_role("button", name="x", exact=True).click()
    page.locator("[data-panel=histogram]").get_by_role("button", name="y", exact=True).click()
    until(page, f"{OUTLINES} === 1 && /9\\.\\d+ ± /.test({FIGURES})")
    page.get_by_label("Bins", exact=True).select_option("50")
    page.get_by_role("combobox", name="Values").select_option("3")
    page.get_by_role("button", name="Density", exact=True).click()
    until(page, f"{PANEL}.innerText.includes('Density, 1/(m/s²)')")
    assert serious(page, PANEL) == []
    reload(page)
    until(page, f"{OUTLINES} === 1 && {PANEL}.innerText.includes('Density, 1/(m/s²)')")


def test_figures_of_a_recording_are_those_of_numpy(recorded: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = opened_recording(recorded, open_page)
    show(page, "Histogram")
    until(page, f"{OUTLINES} === 3")
    view = page.evaluate("imuscope.view.value")
    [info] = ask(recorded, "GET", "/api/recordings")
    body: dict[str, Any] = {
        "source": info["id"],
        "signals": [f"{view['device']}/RateOfTurn.x"],
        "t0": view["end"] - view["span"],
        "t1": view["end"],
    }
    [samples] = ask(recorded, "POST", "/api/analysis/expression", body)
    values = np.array(samples["figures"]["values"])
    row = page.evaluate(f"[...{PANEL}.querySelectorAll('tbody tr')[0].cells].map(one => one.innerText)")
    plain = [cell.replace("−", "-").replace("\u2009", "") for cell in row]
    assert int(plain[1]) == len(values)
    mean, sigma = (float(part.split()[0]) for part in plain[2].split(" ± "))
    assert mean == pytest.approx(values.mean(), rel=1e-4, abs=1e-6)
    assert sigma == pytest.approx(values.std(ddof=1), rel=1e-3)
    assert float(plain[5].split()[0]) == pytest.approx(np.diff(np.histogram_bin_edges(values, "fd"))[0], rel=1e-3)
    page.evaluate("{const {end, span} = imuscope.view.value; imuscope.actions.select(end - span / 2, end);}")
    until(page, f"Number({PANEL}.querySelectorAll('tbody td')[0].innerText.replace(/\\D/g, '')) < {0.6 * len(values)}")


def test_on_a_phone(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    page = opened(serve(SOURCE), open_page, PHONE)
    page.locator(".arrange-phone").tap()
    page.get_by_role("button", name="Show Histogram").tap()
    page.get_by_text("Done", exact=True).tap()
    until(page, f"{OUTLINES} === 3")
    assert page.evaluate("document.scrollingElement.scrollWidth") <= PHONE[0]
    small = page.evaluate(TARGETS.replace("document.querySelectorAll", f"{PANEL}.querySelectorAll"))
    assert not small, small
