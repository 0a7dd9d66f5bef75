"""Helpers for checks against other programs: fetching, running, simulated devices, comparing."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).parent
STARTS_S = 600.0  # installing one of them, on a small machine
LASTS_S = 300.0
AWAKE_S = 1.0  # an MTi that has just got power takes WakeUpAck alone for half a second


class DiffersError(Exception):
    """The output of a program differs from the expected one."""


@dataclass(frozen=True)
class Checkout:
    """A public repository at a fixed version."""

    name: str
    url: str
    version: str

    def fetched(self, folder: Path) -> Path:
        """Path of the file, downloaded if necessary."""
        place = folder / self.name
        if not place.exists():
            run(["git", "clone", "--quiet", self.url, str(place)], folder)
            run(["git", "checkout", "--quiet", self.version], place)
        return place


def run(command: list[str], folder: Path, env: Mapping[str, str] | None = None, limit_s: float = LASTS_S) -> str:
    """Run a command; what it printed.

    Raises:
        DiffersError: it failed, or is not there.
    """
    try:
        done = subprocess.run(
            command, cwd=folder, env=env, capture_output=True, text=True, errors="replace", timeout=limit_s
        )
    except OSError as error:
        raise DiffersError(f"{command[0]} cannot be run: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        raise DiffersError(f"{' '.join(command)} did not end within {limit_s:.0f} s") from None
    if done.returncode:
        tail = (done.stdout + done.stderr)[-1500:]
        raise DiffersError(f"{' '.join(command)} ended with {done.returncode}:\n{tail}")
    return done.stdout


@contextmanager
def simulated(device: str, path: Path) -> Iterator[str]:
    """A simulated device behind a serial port at `path`, as `imuscope simulate` offers it."""
    command = [sys.executable, "-m", "imuscope.server.cli", "simulate", device, "--pty", str(path)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            message = process.stdout.readline()
            if not path.exists():
                raise DiffersError(f"the simulator did not start: {message}")
            time.sleep(AWAKE_S)
            yield str(path)
        finally:
            process.terminate()


def expect(printed: str, *lines: str) -> None:
    """DiffersError: one of these lines is not among those that were printed."""
    results = [line.strip() for line in printed.splitlines()]
    for line in lines:
        if line not in results:
            raise DiffersError(f"{line!r} was expected; printed was:\n{printed[-1500:]}")


def imuscope(*words: str) -> str:
    """`imuscope WORDS`; what it printed."""
    return run([sys.executable, "-m", "imuscope.server.cli", *words], ROOT)


def from_pip(folder: Path, package: str, program: str) -> Path:
    """A program of a PyPI package, installed in its own environment if necessary."""
    place = folder / package.partition("=")[0]
    if not (place / "bin" / program).exists():
        run([sys.executable, "-m", "venv", str(place)], folder)
        run([str(place / "bin" / "python"), "-m", "pip", "install", "--quiet", package], folder, limit_s=STARTS_S)
    return place / "bin" / program


def owned(program: str, where: str) -> str:
    """A program that must be installed.

    Args:
        where: its origin.

    Raises:
        DiffersError: it is not on PATH.
    """
    result = shutil.which(program)
    if result is None:
        raise DiffersError(f"there is no {program!r} on PATH. It is {where}; build or install it as its README says.")
    return result
