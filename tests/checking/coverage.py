"""Line and branch coverage of the Python sources: `python -m tests.checking.coverage [PYTEST ARGUMENT …]`.

All tests of Python, in workers as in the check, with what they start and fork. Writes artifacts/coverage/table.txt:
each package, then each file below BAR. What runs as machine code is not seen, nor a process that SIGKILL ends. Tests
that fail only because they are traced, and so slower, do not count: the check runs them without.
"""

import json
import shutil
import subprocess
import sys
from typing import Any

from tests.support.source_files import ROOT

PACKAGES = ("protocols", "recordings", "server", "imuscope")
BAR = 80.0  # percent of lines and branches together
FOLDER = ROOT / "artifacts" / "coverage"


def row(name: str, files: list[dict[str, Any]]) -> str:
    """A line of the table, of one or more files."""
    done, lines, done_branches, branches = (
        sum(file[key] for file in files)
        for key in ("covered_lines", "num_statements", "covered_branches", "num_branches")
    )
    shares = 100 * done / (lines or 1), 100 * done_branches / (branches or 1)
    return f"{shares[0]:5.1f} % of {lines:6}  {shares[1]:5.1f} % of {branches:6}  {name}"


def table(report: dict[str, Any]) -> str:
    """The text of it, from the JSON that coverage writes."""
    files = {name: facts["summary"] for name, facts in report["files"].items()}
    rows = [row(one, [file for name, file in files.items() if name.startswith(f"{one}/")]) for one in PACKAGES]
    below = sorted((file["percent_covered"], name) for name, file in files.items() if file["percent_covered"] < BAR)
    return "\n".join(["     lines           branches", *rows, "", *(row(name, [files[name]]) for _, name in below), ""])


def main(arguments: list[str]) -> int:
    """The command line."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True)

    def run(*words: str) -> int:
        return subprocess.run([sys.executable, "-m", "coverage", *words], cwd=ROOT).returncode

    run("run", "-m", "pytest", "--workers", "6", *arguments)
    status = run("combine", "--quiet") or run("json", "--quiet", f"-o{FOLDER}/report.json")
    (FOLDER / "table.txt").write_text(table(json.loads((FOLDER / "report.json").read_text())))
    print((FOLDER / "table.txt").read_text())
    return status


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
