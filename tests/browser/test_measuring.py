"""Numbers of a measured range of a recording in a real browser, against those of the server and of numpy.

Gestures that measure are tested in test_panels.py.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import click, press, serious, show
from tests.browser.test_panels import ABOUT, BYTES, COUNTED, HISTOGRAM, INK, OUTLINES, XY
from tests.browser.test_panels import MEASURED as PANEL
from tests.browser.test_recordings import opened, recorded
from tests.support.chromium import until
from tests.support.server_process import ServerProcess

__all__ = ["recorded"]  # a fixture

COPIED = "window.copied = undefined; navigator.clipboard.writeText = async text => { window.copied = text; }"


def figures(page: Page) -> list[dict[str, str]]:
    """The lines of the table as copied."""
    page.evaluate(COPIED)
    click(page, "button", "Copy CSV", "window.copied !== undefined")
    return list(csv.DictReader(io.StringIO(page.evaluate("window.copied"))))


def test_numbers_of_a_recording_are_those_of_numpy(recorded: ServerProcess, open_page: Callable[..., Page]) -> None:
    """The same definitions everywhere: counted on the page, on the server, and here."""
    page = opened(recorded, open_page)
    for whole in (True, False):
        measure_as_numpy(recorded, page, whole)
    page.evaluate("imuscope.actions.fit()")
    go_to_a_condition(recorded, page)
    page.keyboard.press("Escape")
    open_the_bytes(page)
    zoom_the_y_axis(recorded, page)
    page.evaluate("imuscope.actions.fit()")
    pair_on_the_server(recorded, page)
    histogram_as_numpy(recorded, page)


def measure_as_numpy(recorded: ServerProcess, page: Page, whole: bool) -> None:
    """The same definitions everywhere: counted on the page, on the server, and here."""
    if not whole:
        page.evaluate(
            """const {end, span} = imuscope.view.value;
            imuscope.actions.select(end - 0.7 * span, end - 0.3 * span);"""
        )
    press(page, "b", COUNTED)
    rows = {row["signal"]: row for row in figures(page)}
    [info] = recorded.request("GET", "/api/recordings")
    device = page.evaluate("imuscope.view.value.device")
    for name in ("Acceleration.x", "RateOfTurn.z"):
        row = rows[name]
        body: dict[str, Any] = {
            "source": info["id"],
            "signals": [f"{device}/{name}"],
            "t0": min(float(row["t_a_s"]), float(row["t_b_s"])),
            "t1": max(float(row["t_a_s"]), float(row["t_b_s"])),
        }
        [samples] = recorded.request("POST", "/api/analysis/expression", body)
        time, values = np.array(samples["figures"]["time"]), np.array(samples["figures"]["values"])
        steps = np.diff(time)
        expected = {
            "n": len(values),
            "mean": values.mean(),
            "sigma": values.std(ddof=1),
            "rms": np.sqrt((values**2).mean()),
            "min": values.min(),
            "max": values.max(),
            "peak_to_peak": np.ptp(values),
            "slope": np.polyfit(time - time[0], values, 1)[0],
            "integral": np.trapezoid(values, time),
            "gaps": np.count_nonzero(steps > 1.5 * np.median(steps)),
        }
        assert len(values) > 100
        for key, value in expected.items():
            assert float(row[key]) == pytest.approx(value, rel=1e-6, abs=1e-9), key
        assert row["slope_unit"] == samples["units"]["values"].replace("m/s²", "m/s³").replace("°/s", "°/s²")
    press(page, "b", f"{PANEL} === null")


def go_to_a_condition(recorded: ServerProcess, page: Page) -> None:
    """Opened by a key, typed, and gone to; the key N goes on."""
    page.keyboard.press("j")
    page.keyboard.type("norm(Acceleration) > 9.9 m/s²")
    press(page, "Enter", "document.querySelector('.go-to-said')?.innerText.includes('UTC, true')")
    first = page.evaluate("imuscope.cursor.value.time")
    [info] = recorded.request("GET", "/api/recordings")
    body = {
        "source": info["id"],
        "device": page.evaluate("imuscope.view.value.device"),
        "signals": ["norm(Acceleration) > 9.9 m/s²"],
    }
    [result] = recorded.request("POST", "/api/analysis/intervals", body)
    assert result["figures"]["begin"][0] == pytest.approx(first, abs=1e-6)
    page.evaluate("document.activeElement.blur()")
    press(page, "n", f"imuscope.cursor.value.time > {first}")
    assert page.evaluate("imuscope.cursor.value.time") == pytest.approx(result["figures"]["begin"][1], abs=1e-6)
    assert serious(page, "document.querySelector('.go-to')") == []


def open_the_bytes(page: Page) -> None:
    press(page, "p", BYTES)
    assert page.get_by_role("button", name="Show in plot").is_visible()
    page.keyboard.press("Escape")


def zoom_the_y_axis(recorded: ServerProcess, page: Page) -> None:
    labels = page.locator(".plot .y-gutter").first
    box = labels.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.wheel(0, -600)
    until(page, "document.querySelector('.y-mark').textContent === 'fixed'")
    before = labels.get_attribute("aria-label")
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 + 20, steps=3)
    page.mouse.up()
    until(page, f"document.querySelector('.y-gutter').ariaLabel !== {before!r}")
    labels.press("Enter")
    until(page, "document.querySelector('dialog[open] .y-axis-form') !== null")
    assert serious(page, "document.querySelector('dialog[open]')") == []
    click(page, "button", "Automatic", "document.querySelector('.y-mark').textContent === ''", exact=True)


def pair_on_the_server(recorded: ServerProcess, page: Page) -> None:
    show(page, "XY plot", "Histogram")
    until(page, f"/[1-9].* samples · same sample times/.test({ABOUT})")
    until(page, f"{INK} > 20")
    [info] = recorded.request("GET", "/api/recordings")
    for part in (1, 2):  # half of it: no longer the same range, and again every sample of it
        page.evaluate(
            "part => {const {end, span} = imuscope.view.value; imuscope.actions.select(end - span / part, end);}", part
        )
        view = page.evaluate("imuscope.view.value")
        body = {
            "source": info["id"],
            "signals": [f"{view['device']}/MagneticField.x"],
            "t0": view["end"] - view["span"],
            "t1": view["end"],
        }
        [x] = recorded.request("POST", "/api/analysis/statistics", body)
        until(page, f"Number({ABOUT}.split('samples')[0].replace(/\\D/g, '')) === {x['figures']['n']}")
    assert serious(page, XY) == []


def histogram_as_numpy(recorded: ServerProcess, page: Page) -> None:
    page.evaluate("imuscope.actions.fit()")
    until(page, f"{OUTLINES} === 3")
    view = page.evaluate("imuscope.view.value")
    [info] = recorded.request("GET", "/api/recordings")
    body: dict[str, Any] = {
        "source": info["id"],
        "signals": [f"{view['device']}/RateOfTurn.x"],
        "t0": view["end"] - view["span"],
        "t1": view["end"],
    }
    [samples] = recorded.request("POST", "/api/analysis/expression", body)
    values = np.array(samples["figures"]["values"])
    until(page, f"Number({HISTOGRAM}.querySelectorAll('tbody td')[0].innerText.replace(/\\D/g, '')) === {len(values)}")
    row = page.evaluate(f"[...{HISTOGRAM}.querySelectorAll('tbody tr')[0].cells].map(one => one.innerText)")
    plain = [cell.replace("−", "-").replace("\u2009", "") for cell in row]
    assert int(plain[1]) == len(values)
    mean, sigma = (float(part.split()[0]) for part in plain[2].split(" ± "))
    assert mean == pytest.approx(values.mean(), rel=1e-4, abs=1e-6)
    assert sigma == pytest.approx(values.std(ddof=1), rel=1e-3)
    assert float(plain[5].split()[0]) == pytest.approx(np.diff(np.histogram_bin_edges(values, "fd"))[0], rel=1e-3)
    page.evaluate("{const {end, span} = imuscope.view.value; imuscope.actions.select(end - span / 2, end);}")
    until(
        page, f"Number({HISTOGRAM}.querySelectorAll('tbody td')[0].innerText.replace(/\\D/g, '')) < {0.6 * len(values)}"
    )
