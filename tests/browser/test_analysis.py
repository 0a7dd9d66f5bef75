"""Analyses beside the plots in a real browser, from recorded answers: colours in both themes, readings, and a phone.

What is asked of the server is tested without a browser, in web/src/extensions/analysis/view.test.tsx; the figures of
a real server are shown in test_recordings.py.
"""

from collections.abc import Callable
from typing import Any

from playwright.sync_api import Page

from tests.browser.page_checks import DESKTOP, PHONE, fits, press, serious, show, small_targets
from tests.browser.recorded.stories import Story
from tests.support.chromium import until

PLACE = "document.querySelector('[data-panel=analysis]')"
CURVES = "document.querySelectorAll('[data-panel=analysis] path.trace').length"
OPAQUE = f"getComputedStyle({PLACE}.querySelector('.result')).opacity === '1'"  # it was dimmed until it was answered
NUMBERS = [1, 2, 3, 4, 5]
EDGES = """(() => {
  const stack = document.querySelector('.stack');
  const style = getComputedStyle(stack);
  const [gutter, tail] = ['--gutter-w', '--tail-w'].map(name => parseFloat(style.getPropertyValue(name)));
  const plots = stack.getBoundingClientRect();
  const picture = document.querySelector('.spectrogram canvas')?.getBoundingClientRect();
  return picture && [picture.left - plots.left - gutter, plots.right - picture.right - tail].map(Math.round).join(' ');
})()"""
STATES = ("met", "above", "open")


def figures(axis: str) -> dict[str, Any]:
    """Of one signal, for a spectrum and for an Allan deviation, with each verdict on the data sheet."""
    peak = {"frequency": 31.7, "uncertainty": 0.001, "rms": 0.25, "above_floor": 22.1, "order": 1, "harmonic_of": None}
    return {
        "signal": f"Acceleration.{axis}",
        "device": "1",
        "units": {
            **{"psd": "m/s²/√Hz", "frequency": "Hz", "peaks.rms": "m/s²", "adev": "m/s²", "mean": "m/s²"},
            "parameters.random_walk.value": "m/s²/√Hz",
        },
        "figures": {
            **dict.fromkeys(("frequency", "psd", "tau", "adev", "low", "high", "model", "data_sheet"), NUMBERS),
            "peaks": [peak],
            "parameters": {"random_walk": {"value": 0.002, "low": 0.0019, "high": 0.0021}},
            "verdicts": [
                {"parameter": "random_walk", "state": state, "words": f"Random walk: {state}."} for state in STATES
            ],
            **{"segments": 8, "length": 256, "rate": 100, "n": 5000, "mean": 9.81},
            "notes": ["1 gap, 0.5 s in sum: nothing is computed across a gap."],
        },
    }


def test_figures_on_a_desktop_and_a_phone(open_page: Callable[..., Page]) -> None:
    """And on a phone, where the panel has room and a finger hits all of it."""
    results = [figures(axis) for axis in "xyz"]
    with Story("xbus", answers={f"POST /api/analysis/{name}": results for name in ("psd", "allan")}) as story:
        page = story.open(open_page)
        press(page, "a", f"{CURVES} === 3")
        box = page.locator(".analysis-chart > svg").bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        until(page, "/\\d Hz/.test(document.querySelector('.analysis-reading').innerText)")
        until(page, OPAQUE)
        assert serious(page, PLACE) == []
        page.get_by_role("button", name="Allan deviation").click()
        until(page, f"{PLACE}.querySelectorAll('.analysis-verdicts li').length === {3 * len(STATES)}")
        until(page, OPAQUE)
        assert serious(page, PLACE) == []

        page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
        assert fits(page)
        assert fits(page, place=PLACE)
        assert small_targets(page, PLACE) == []


def test_a_spectrogram_stands_under_the_plots_to_the_pixel(open_page: Callable[..., Page]) -> None:
    """And the plots beside panels keep room for more than a strip of themselves."""
    result = figures("x")
    result["figures"] |= {"time": NUMBERS, "psd": [NUMBERS] * 5, "step": 100}
    with Story("xbus", answers={"POST /api/analysis/spectrogram": [result]}) as story:
        page = story.open(open_page, width=DESKTOP[0], height=DESKTOP[1])
        show(page, "Spectrogram")
        until(page, f"{EDGES} === '0 0'")
        show(page, "XY plot", "Histogram")
        until(page, "document.querySelector('.stack').clientHeight >= 340")
