"""docs/compatibility.md: the versions that it names are those that files, wire, HTTP, plug-ins and commands say."""

import re
import tomllib

from imuscope.server import wire
from imuscope.server.generators import files as generated_files
from imuscope.server.version import VERSION
from tests.support.each_row import each_row
from tests.support.source_files import ROOT, python_files, text_of

ROW = re.compile(r"^\| ([^|]+) \| ([^|]+) \| ([^|]*) \| [^|]+ \|$", re.MULTILINE)
PROMISES = {
    name: (where, now.strip("` ")) for name, where, now in ROW.findall((ROOT / "docs/compatibility.md").read_text())
}
RELEASE = VERSION.rpartition(".")[0]
PAGE = (ROOT / "web" / "src" / "workspace" / "parts.ts").read_text()
DOOR = ROOT / "web" / "src" / "extensions" / "packages" / "door.ts"


def version_in(name: str, constant: str) -> str:
    """Version that a file states; "" if the extension it belongs to was removed."""
    paths = [path for path in python_files("protocols", "recordings", "server") if path.as_posix().endswith(f"/{name}")]
    match = [re.search(rf"^{constant}(?:: [^=]+)? = (\S+)", text_of(path), re.MULTILINE) for path in paths]
    return match[0][1].strip('"') if match and match[0] else ""


DECLARED = {
    "recording (`.mcap`)": version_in("mcap/writer.py", "FORMAT"),
    "edits beside a recording": version_in("sidecar.py", "VERSION"),
    "snapshot of settings": version_in("configuration/snapshots.py", "FORMAT"),
    "record of a pending rollback": version_in("configuration/rollback.py", "FORMAT"),
    "file of alarms": version_in("alarm_file.py", "FORMAT"),
    "workspace": next(iter(re.findall(r"const VERSION = (\d+)", PAGE)), ""),
    "evidence file": version_in("evidence/content.py", "FORMAT"),
    "WebSocket": wire.SUBPROTOCOL,
    "HTTP API": RELEASE,
    "reports of robots to a fleet": version_in("fleet/model/reports.py", "VERSION"),
    "holder of a shared port": version_in("holder/messages.py", "VERSION"),
    "plug-in API (`imuscope.plugin`)": version_in("protocols/family/plugins.py", "API_VERSION"),
    "panels of extension packages": next(
        iter(re.findall(r"const VERSION = (\d+)", DOOR.read_text() if DOOR.exists() else "")), ""
    ),
    "command line": RELEASE,
    "Python (`import imuscope`)": RELEASE,
    "settings file": "none",
}
OF_EXTENSIONS = {"panels of extension packages", "file of alarms", "evidence file", "reports of robots to a fleet"}


def test_each_promise_has_a_version() -> None:
    assert set(PROMISES) - {"part", "---"} == set(DECLARED)


@each_row("name", DECLARED)
def test_a_promise_names_the_version_that_is_reported(name: str) -> None:
    assert PROMISES[name][1] == DECLARED[name] or (name in OF_EXTENSIONS and not DECLARED[name])


def test_the_http_api_states_the_release_and_the_wire() -> None:
    openapi = generated_files.document()
    assert openapi["info"]["version"] == VERSION
    assert {"version", "wire"} <= set(openapi["components"]["schemas"]["Build"]["required"])


def test_keys_of_a_fleet_have_the_version_of_its_reports() -> None:
    assert (
        version_in("fleet/model/keys.py", "ROOT").removeprefix("imuscope/") == DECLARED["reports of robots to a fleet"]
    )


def test_the_version_is_that_of_the_project_file() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == VERSION, "what is installed is of another version: run `uv sync`"
    assert f"imuscope-{VERSION}-py3" in (ROOT / "README.md").read_text()


def test_the_changelog_has_the_release_with_its_date() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text()
    assert re.search(rf"^## \[{re.escape(VERSION)}\] - \d{{4}}-\d\d-\d\d$", changelog, re.MULTILINE)
