"""Promises of the Dockerfile, checked without Docker: no root, no home, nothing writable but what is handed in.

The package cannot be written. A process that is root here gives up the right to ignore permissions, which makes it
obey them as any user does.
"""

import ctypes
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.support.server_process import ROOT
from tests.support.timeouts import PATIENCE_S

PR_CAPBSET_DROP, CAP_DAC_OVERRIDE = 24, 1
START = """
import sys
from pathlib import Path
from imuscope.protocols.native import kernels as compiled
from imuscope.protocols.registry import families as registry
assert registry.detect(bytes.fromhex("fa ff 36 05 10 20 02 00 01 93" * 20))[0].protocol == "xbus"
print(compiled.is_complete())
"""


def obey_permissions() -> None:
    """Called in the child before exec: from here on file permissions apply to root too."""
    if os.geteuid() == 0:
        ctypes.CDLL(None, use_errno=True).prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, 0, 0, 0)


def seal(folder: Path, mode: int) -> None:
    for path in [folder, *folder.rglob("*")]:
        path.chmod(mode | (0o111 if path.is_dir() else 0) if not path.is_symlink() else mode)


@pytest.fixture
def image(tmp_path: Path) -> Iterator[Path]:
    """The packages, as an image would hold them: their own copy."""
    folder = tmp_path / "image"
    for name in ("imuscope", "protocols", "recordings", "server"):
        shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__", "page"))
    shutil.copy(ROOT / "pyproject.toml", folder)  # the version, where the package is not installed
    yield folder
    seal(folder, 0o644)


def run(image: Path, arguments: list[str], cwd: Path, **extra: str) -> subprocess.CompletedProcess[str]:
    """Python in the image's environment: no home, no place for temporary files unless given."""
    env = {"PATH": os.environ["PATH"], "PYTHONPATH": str(image), "PYTHONDONTWRITEBYTECODE": "1"}
    env |= {"HOME": str(image), "TMPDIR": str(image)} | extra
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=cwd,
        env=env,
        capture_output=True,
        text=True,
        timeout=2 * PATIENCE_S,
        check=False,
        preexec_fn=obey_permissions,
    )


@pytest.fixture
def sealed(image: Path) -> Callable[[], None]:
    """Make the image read-only; the test is skipped where that does not bind this user."""

    def close() -> None:
        seal(image, 0o444)
        write = f"open({str(image / 'probe')!r}, 'w')"
        if run(image, ["-c", write], image).returncode == 0:
            pytest.skip("this user may write anywhere, and cannot give that up")

    return close


def test_the_packages_run_where_nothing_can_be_written(image: Path, sealed: Callable[[], None]) -> None:
    sealed()
    done = run(image, ["-c", START], Path("/proc"))
    assert done.returncode == 0, done.stderr
    assert (done.stdout.split(), done.stderr) == (["True"], "")


def test_the_dockerfile_keeps_its_promises() -> None:
    text = (ROOT / "Dockerfile").read_text()
    stages = re.findall(r"^FROM (\S+)", text, re.MULTILINE)
    assert len(stages) == 2, "what builds is not what runs"
    assert len(set(stages)) == 1, "the environment that was built links to this very Python"
    assert re.fullmatch(r"python:\d+\.\d+\.\d+-slim-[a-z]+", stages[0]), "a tag that moves is another image tomorrow"
    assert re.search(r"^RUN pip install uv==\d+\.\d+\.\d+$", text, re.MULTILINE), "so is a tool without a version"
    last = text[text.rindex("FROM ") :]
    user = re.search(r"^USER (\d+):(\d+)$", last, re.MULTILINE)
    assert user, "a number, so that a cluster can see that it is not root"
    assert int(user[1]) > 0
    assert "HEALTHCHECK" in last
    assert "/healthz" in last
    assert re.findall(r"^COPY --from=build (\S+) (\S+)$", last, re.MULTILINE) == [("/app", "/app")]
    ignored = (ROOT / ".dockerignore").read_text().split()
    shipped = {line[1:] for line in ignored if line.startswith("!")}
    needed = {
        "pyproject.toml",
        "uv.lock",
        "README.md",
        "LICENSE",
        "imuscope",
        "protocols",
        "recordings",
        "server",
        "web",
    }
    assert needed <= shipped
