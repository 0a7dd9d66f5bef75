"""Keys typed before a panel is there, and a document that hidden words do not make longer."""

from collections.abc import Callable

from playwright.sync_api import Page, Route

from tests.browser.page_checks import go_to, opened
from tests.support.chromium import until
from tests.support.server_process import ServerProcess


def test_typed_keys_wait_for_the_field(server: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = opened(server, open_page)
    held: list[Route] = []
    page.route("**/assets/*.js", lambda route: held.append(route))
    with page.expect_request("**/assets/*.js"):
        page.keyboard.press("s")
    page.keyboard.type("rate z")
    assert held, "the code of the panel comes when it is first opened"
    for route in held:
        route.continue_()
    page.unroute("**/assets/*.js")
    until(page, "document.activeElement.value === 'rate z'")
    assert page.evaluate("document.querySelector('dialog[open]') === null"), "A is the key of Analysis"


def test_the_document_does_not_scroll(server: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = opened(server, open_page)
    for place in ("#/", "#/configure", "#/recordings"):
        go_to(page, place)
        until(page, "document.querySelector('main') !== null")
        page.evaluate("scrollTo(0, 500); document.body.scrollTop = 500")
        assert page.evaluate("[scrollY, document.body.scrollTop]") == [0, 0], place
