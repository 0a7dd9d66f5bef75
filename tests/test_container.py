"""Promises of the Dockerfile, checked without Docker: no root, no home, nothing writable but what is handed in.

The image ships compiled loops in a folder that cannot be written, and the package itself cannot be written either. A
process that is root here gives up the right to ignore permissions, which makes it obey them as any user does.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.server_process import ROOT
from tests.timeouts import PATIENCE_S

PR_CAPBSET_DROP, CAP_DAC_OVERRIDE = 24, 1
PROBE = """
import sys
from pathlib import Path
from imuscope.server.commands.common import prepare_decoders
prepare_decoders(Path(sys.argv[1]))
from imuscope.protocols import jit
print(jit.is_loaded(), jit.recompiled())
"""

START = """
import sys
from pathlib import Path
from imuscope.server.commands.common import prepare
prepare(Path(sys.argv[1]))
from imuscope.protocols.registry import detect
print(detect(bytes.fromhex("fa ff 36 05 10 20 02 00 01 93" * 20))[0].protocol)
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
    """The packages, as an image would hold them: their own copy, with a folder of compiled loops beside it."""
    folder = tmp_path / "image"
    for name in ("imuscope", "protocols", "recordings", "server"):
        shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__", "page"))
    shutil.copy(ROOT / "pyproject.toml", folder)  # the version, where the package is not installed
    yield folder
    seal(folder, 0o644)


def run(image: Path, arguments: list[str], cwd: Path, **extra: str) -> subprocess.CompletedProcess[str]:
    """Python in the image's environment: no home, no place for temporary files unless given."""
    env = {"PATH": os.environ["PATH"], "PYTHONPATH": str(image), "PYTHONDONTWRITEBYTECODE": "1"}
    env |= {"HOME": str(image), "TMPDIR": str(image), "NUMBA_CACHE_DIR": str(image / "numba")} | extra
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


def compile_ahead(image: Path, cwd: Path) -> None:
    """Build steps of the Dockerfile."""
    [command] = re.findall(r'^RUN .* -c "(.*warm.*)" && ls /app/(numba/\S+)$', (ROOT / "Dockerfile").read_text(), re.M)
    done = run(image, ["-c", command[0]], cwd)
    assert done.returncode == 0, done.stderr
    assert list(image.glob(command[1]))


@pytest.fixture
def sealed(image: Path) -> Callable[[], None]:
    """Make the image read-only; the test is skipped where that does not bind this user."""

    def close() -> None:
        seal(image, 0o444)
        write = f"open({str(image / 'probe')!r}, 'w')"
        if run(image, ["-c", write], image).returncode == 0:
            pytest.skip("this user may write anywhere, and cannot give that up")

    return close


@pytest.mark.slow  # the next one has the compiled loops of these tests
def test_loops_compiled_in_the_image_are_used(image: Path, sealed: Callable[[], None], tmp_path: Path) -> None:
    compile_ahead(image, tmp_path)
    sealed()
    (tmp_path / "tmp").mkdir()
    done = run(image, ["-c", PROBE, str(tmp_path)], tmp_path, TMPDIR=str(tmp_path / "tmp"))
    assert done.returncode == 0, done.stderr
    assert "compiling" not in done.stderr
    assert done.stdout.split() == ["True", "0"], "it was compiled again"
    assert list((tmp_path / "tmp").iterdir()) == []


def test_loops_that_cannot_be_written_are_used(image: Path, sealed: Callable[[], None], tmp_path: Path) -> None:
    """The packages are those of these tests: compiled code is for the files that it was made from."""
    shutil.copytree(os.environ["NUMBA_CACHE_DIR"], image / "numba")
    sealed()
    (tmp_path / "tmp").mkdir()
    done = run(image, ["-c", PROBE, str(tmp_path)], ROOT, TMPDIR=str(tmp_path / "tmp"), PYTHONPATH=str(ROOT))
    assert done.returncode == 0, done.stderr
    assert "compiling" not in done.stderr
    assert done.stdout.split() == ["True", "0"], "it was compiled again"
    assert list((tmp_path / "tmp").iterdir()) == []


def test_without_compiled_code_it_starts_and_reports_it(image: Path, sealed: Callable[[], None]) -> None:
    sealed()
    done = run(image, ["-c", START, str(image / "data")], Path("/proc"))
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["xbus"]
    assert "this run only" in done.stderr


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
