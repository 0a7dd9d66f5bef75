"""web/build.py: staleness of the page, and errors of npm."""

import importlib.util
import json
import re
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

from tests.support.each_row import each_row
from tests.support.server_process import ROOT
from tests.support.source_files import python_files, text_of


@pytest.fixture
def build(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module, loaded as hatchling loads it, for a small web/ folder of the test."""
    spec = importlib.util.spec_from_file_location("page_build", ROOT / "web" / "build.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    web, page = tmp_path / "web", tmp_path / "server" / "page"
    (web / "src").mkdir(parents=True)
    page.mkdir(parents=True)
    for name in ("build.py", "index.html", "package.json", "package-lock.json", "src/main.ts", "src/main.test.ts"):
        (web / name).write_text(name)
    (page / "index.html").write_text("page")
    for name, value in {"WEB": web, "PAGE": page, "STAMP": page / ".sources"}.items():
        monkeypatch.setattr(module, name, value)
    return module


def test_a_change_of_sources_makes_the_page_stale(build: ModuleType) -> None:
    assert not build.is_fresh()
    build.STAMP.write_text(build.digest(build.sources()))
    assert build.is_fresh()
    assert build.build() is False  # and Node is not even looked for
    (build.WEB / "src" / "main.test.ts").write_text("another test")
    assert build.is_fresh()
    (build.WEB / "src" / "main.ts").write_text("another page")
    assert not build.is_fresh()


def test_a_renamed_source_makes_the_page_stale(build: ModuleType) -> None:
    before = build.digest(build.sources())
    (build.WEB / "src" / "main.ts").rename(build.WEB / "src" / "start.ts")
    assert build.digest(build.sources()) != before


@each_row(
    ("printed", "hint"),
    [
        ("npm error code ENOTFOUND\nnpm error network request failed", "NPM_CONFIG_REGISTRY"),
        ("npm error code UNABLE_TO_GET_ISSUER_CERT_LOCALLY", "NODE_EXTRA_CA_CERTS"),
        ("npm error code SELF_SIGNED_CERT_IN_CHAIN", "NODE_EXTRA_CA_CERTS"),
    ],
)
def test_a_registry_out_of_reach_is_one_line_with_a_hint(build: ModuleType, printed: str, hint: str) -> None:
    message = build._npm_failed(printed)
    assert hint in message
    assert "\n" not in message


def test_certificates_that_pip_knows_are_handed_to_npm(
    build: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    certificates = tmp_path / "certificates.pem"
    certificates.write_text("")
    for name in ("SSL_CERT_FILE", "NODE_EXTRA_CA_CERTS"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PIP_CERT", str(certificates))
    shown = build._run([sys.executable, "-c", "import os; print(os.environ['NODE_EXTRA_CA_CERTS'])"])
    assert shown.stdout.strip() == str(certificates)


def test_the_first_load_stays_within_its_budget() -> None:
    """What the frame of the page names is fetched at once; other pages and dialogs when they are opened."""
    page = ROOT / "server" / "page"
    if not (page / ".sources").is_file():
        pytest.skip("the page has not been built: python web/build.py")
    frame = page / "index.html"
    named = re.findall(r'(?:src|href)="\./([^"]+)"', frame.read_text())
    assert len(named) > 3
    first = [frame, *(page / name for name in named), *page.glob("assets/socket-worker-*.js")]
    every = [path for path in page.rglob("*") if path.is_file() and path.suffix not in {".gz", ".br"}]
    assert sum(map(_compressed, first)) <= 200_000, "bytes of the first load, compressed"
    assert sum(map(_compressed, every)) <= 480_000, "bytes of the whole page with its guide, compressed"


def _compressed(path: Path) -> int:
    """The size in bytes as it is served: files that do not shrink have no compressed twin."""
    packed = path.with_name(path.name + ".gz")
    return (packed if packed.is_file() else path).stat().st_size


def test_licences_of_what_is_bundled_stand_beside_the_page(build: ModuleType) -> None:
    """Build and test dependencies are not in the page; bundled ones without a licence are refused."""
    packages = {
        "": {"name": "page"},
        "node_modules/preact": {"version": "10.0.0", "license": "MIT"},
        "node_modules/vite": {"version": "8.0.0", "license": "MIT", "dev": True},
    }
    (build.WEB / "package-lock.json").write_text(json.dumps({"packages": packages}))
    with pytest.raises(build.BuildError, match="preact has no licence text"):
        build.notices()
    folder = build.WEB / "node_modules" / "preact"
    folder.mkdir(parents=True)
    (folder / "LICENSE").write_text("Permission is hereby granted")
    report = build.notices()
    assert "preact 10.0.0 (MIT)" in report
    assert "Permission is hereby granted" in report
    assert "vite" not in report


def test_a_build_without_git_takes_its_commit_from_the_environment(
    build: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The image is built without `.git`, and did not know what it was made from."""
    monkeypatch.setattr(build, "build", lambda: None)
    monkeypatch.setattr(build, "build_native", lambda: None)
    monkeypatch.setattr(build, "PAGE", ROOT / "server" / "page")
    monkeypatch.setenv(build.COMMIT, "0123abcd")
    assert f'{build.COMMIT}="$COMMIT"' in (ROOT / "Dockerfile").read_text()
    hook = build.PackageBuildHook.__new__(build.PackageBuildHook)  # hatchling, which makes it, is no part of the tests
    included: dict[str, dict[str, str]] = {"force_include": {}}
    hook.initialize("standard", included)
    [(file, place)] = included["force_include"].items()
    assert (Path(file).read_text(), place) == ("0123abcd\n", "imuscope/server/commit.txt")
    hook.finalize("standard", included, "")


def test_an_editable_installation_has_compiled_sources(build: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first start in a clone compiled 450 modules, which took longer than everything else in it."""
    monkeypatch.setattr(build, "build", lambda: None)
    monkeypatch.setattr(build, "build_native", lambda: None)
    monkeypatch.setattr(build, "ROOT", build.WEB.parent)
    (build.WEB.parent / "server" / "app.py").write_text("pass")
    hook = build.PackageBuildHook.__new__(build.PackageBuildHook)
    hook.initialize("editable", {})
    hook.finalize("editable", {}, "")
    assert [path.name.partition(".")[0] for path in build.WEB.parent.rglob("*.pyc")] == ["app"]


def test_machine_code_is_built_again_after_a_pull_that_changed_a_kernel() -> None:
    """Regression: kernels that moved to files of another name were not, and decoding ran as plain Python."""
    keys = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["uv"]["cache-keys"]
    watched = {path for key in keys for path in ROOT.glob(key["file"])}
    kernels = {path for path in python_files("protocols", "recordings", "server") if "\n@compiled(" in text_of(path)}
    assert len(kernels) > 10
    assert kernels <= watched
