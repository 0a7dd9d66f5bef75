"""Module state of the page: each instance is listed with its reason, and none is added.

What is shown, selected, typed or opened belongs to a component (useSignal), to a view (web/src/data/view-state.ts) or
to a page (web/src/page/app-state.ts), so that two of them in one document know nothing of each other.
"""

import re
from collections.abc import Iterator
from pathlib import Path

from tests.support.source_files import ROOT

SOURCES = ROOT / "web" / "src"
NOT_CHECKED = ("testing/",)  # not part of the page
LISTED: dict[str, tuple[set[str], str]] = {
    "data/render-loop.ts": ({"painters", "isRunning", "drawn"}, "a document draws all of its canvases in one frame"),
    "extension/extension.tsx": ({"extensions"}, "filled while modules are loaded"),
    "extensions/map/path.ts": ({"origins"}, "a cache by channel"),
    "shell/main.tsx": ({"store", "app"}, "the page starts here"),
    "page/route.ts": ({"route", "reopened"}, "a document has one address, which it may open once more"),
    "panels/registry.ts": ({"panels", "added"}, "filled while modules are loaded: those of packages come later"),
    "plots/canvas-style.ts": ({"hatches"}, "a cache of patterns"),
    "recordings/library-filter.ts": ({"namesIn", "texts"}, "caches by list, and by recording"),
    "recordings/visible-range.ts": ({"#lastPixels"}, "a first guess, until its plots have a width"),
    "ui/dom/canvas.ts": ({"cache", "cachedTheme"}, "colours of the theme, read once"),
    "ui/dom/theme.ts": ({"theme"}, "a document has one theme"),
    "workspace/parts.ts": ({"parts"}, "filled while modules are loaded"),
    "wire/capabilities.ts": (
        {"capabilities", "byName", "abbreviations", "isViewOnly"},
        "all pages of a document have one server",
    ),
}
WORKER = "wire/socket-worker.ts"  # runs once for each store, and shares nothing with the page

STATEMENT = re.compile(
    r"^(?:export )?(?P<kind>const|let|var) (?P<name>\w+)(?P<rest>.*(?:\n(?:[ \t)\]}].*)?)*)", re.MULTILINE
)
STATE = re.compile(
    r"\b(?:(?:signal|computed)\s*[<(]"
    r"|new (?:Weak)?(?:Map|Set)(?:<[^()]*>)?\(\)"  # empty: to be filled
    r"|new (?!Map|Set|RegExp|URL|\w+Array)[A-Z])"
)
FUNCTION = re.compile(r"=>|\bfunction\b")
STATIC = re.compile(r"^ +static (?!readonly)(?P<name>#?\w+) =", re.MULTILINE)


def module_state(text: str) -> Iterator[str]:
    """Names of what changes and exists once: signals, objects and empty collections, `let`, and static fields."""
    for match in STATEMENT.finditer(text):
        value = match["rest"].partition(" = ")[2]
        if match["kind"] != "const" or STATE.search(FUNCTION.split(value, maxsplit=1)[0]):
            yield match["name"]
    for match in STATIC.finditer(text):
        yield match["name"]


def sources() -> Iterator[tuple[str, Path]]:
    for path in sorted(SOURCES.rglob("*.ts*")):
        name = path.relative_to(SOURCES).as_posix()
        if ".test." not in name and not name.startswith(NOT_CHECKED) and name != WORKER:
            yield name, path


def test_no_state_of_a_module_is_added() -> None:
    results = {name: set(module_state(path.read_text(encoding="utf-8"))) for name, path in sources()}
    wrong = [
        f"web/src/{name}: {', '.join(sorted(names ^ LISTED.get(name, (set(), ''))[0]))}"
        for name, names in results.items()
        if names != LISTED.get(name, (set(), ""))[0]
    ]
    assert not wrong, "\n".join([*wrong, "Give the state to a component, a view or a page, or take it off the list."])
    assert LISTED.keys() <= results.keys()


def test_state_of_a_module_is_found() -> None:
    text = """\
export const open = signal(false);
const all: Signal<readonly string[]> = signal([]);
const shown = computed(() => all.value);
const both = {
  left: signal(0),
};
let count = 0;
const seen = new Map<string, Set<number>>();
const known = new Set(["a"]);
const page = new Page({ open });
const size = 5;
const stateOf = perApp(() => signal(""));
const create = () => {
  const inner = signal(0);
  return inner;
};
export class Page {
  static last = 0;
  readonly open = signal(false);
}
"""
    assert list(module_state(text)) == ["open", "all", "shown", "both", "count", "seen", "page", "last"]
