"""Notes of a recording in a real browser: written with times that lead into the plots, and by two people at once."""

from __future__ import annotations

from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.page_checks import serious, show
from tests.browser.test_recordings import ask, opened, recorded, view_of, write_notes
from tests.chromium import until
from tests.server_process import ServerProcess

__all__ = ["recorded"]  # a fixture

PANEL = "document.querySelector('[data-panel=notes]')"
TEXT = f"{PANEL}?.querySelector('.notes-text')?.innerText"


def notes_of(server: ServerProcess, title: str = "") -> str:
    found = [one for one in ask(server, "GET", "/api/recordings") if title in one["title"]]
    return str(found[0]["notes"])


def test_times_are_inserted_and_lead_into_the_plots(recorded: ServerProcess, open_page: Callable[..., Page]) -> None:
    page, other = opened(recorded, open_page), opened(recorded, open_page)
    for one in (page, other):
        show(one, "Notes")
        until(one, f"{TEXT} === 'No notes yet.'")
    page.evaluate("""(() => {
      const { actions } = window.imuscope, { first } = window.imuscopeReplay.bounds;
      actions.pin(first + 2);
      actions.pinMeasure(first + 3);
    })()""")
    write_notes(page, "Turn")
    page.get_by_role("button", name="Insert A to B").click()
    page.get_by_role("button", name="Save", exact=True).click()
    until(page, f"/^Turn \\d\\d:\\d\\d:\\d\\d\\.\\d+ – /.test({TEXT})")
    stored = notes_of(recorded)
    assert stored.startswith("Turn [")
    page.evaluate("window.imuscope.actions.fit()")
    page.locator(".notes-time").click()
    until(page, "window.imuscope.view.value.span < 2")
    first = page.evaluate("window.imuscopeReplay.bounds.first")
    assert abs(view_of(page)["head"] - first - 2) < 0.05
    assert serious(page, PANEL) == []

    # the other person read the notes before that
    write_notes(other, "Dry road")
    other.get_by_role("button", name="Save", exact=True).click()
    until(other, f"{PANEL}.innerText.includes('The notes were changed elsewhere.')")
    until(other, f"{PANEL}.querySelector('.notes-theirs')?.innerText === {stored!r}")
    assert notes_of(recorded) == stored
    assert other.get_by_label("Notes of the recording").input_value() == "Dry road"
    other.get_by_label("Notes of the recording").fill(f"{stored}\nDry road")
    other.keyboard.press("Control+Enter")
    until(other, f"{TEXT}?.includes('Dry road')")
    assert notes_of(recorded) == f"{stored}\nDry road"
