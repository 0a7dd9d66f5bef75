"""Files of Rerun's web viewer, extracted once from the installed wheel into the cache.

The viewer is compiled into Rerun's own program: 43 MB of WebAssembly and its glue. The program is started on a free
loopback port, the two files are downloaded from it, and it is ended; they are stored compressed under
<data>/cache/rerun/<version>, once for each version. So the viewer always matches the installed SDK.

The program would store settings in the home folder and report its use to its makers: it gets a temporary empty home
folder with reporting switched off. Its own index page is not used, because it refers to other hosts.
"""

import gzip
import os
import re
import subprocess
import tempfile
import threading
import urllib.request
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from imuscope.recordings.system.atomic_write import write_atomic
from imuscope.server.integrations.viewer_process import ViewError

NAMES = ("re_viewer.js", "re_viewer_bg.wasm")
COMPRESSION_LEVEL = 6  # of compression: 9 takes three times as long for 1 % less
START_S = 20.0
MAX_BYTES = 200 << 20  # of one file: several times what it is today


def folder_of(data: Path) -> Path:
    return data / "cache" / "rerun" / version("rerun-sdk")


def viewer_files(data: Path) -> Path:
    """The folder with NAMES, each with the suffix `.gz`; created if missing, which takes seconds.

    Raises:
        ViewError: Rerun's program does not start, or the folder cannot be written.
    """
    folder = folder_of(data)
    with _one_at_a_time:
        if all((folder / f"{name}.gz").is_file() for name in NAMES):
            return folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(prefix="rerun-") as home:
                _fetch(folder, Path(home))
        except OSError as error:
            words = (error.strerror or str(error)).lower()
            raise ViewError(f"The files of the viewer cannot be stored: {words}.", "Free some space.") from error
    return folder


_one_at_a_time = threading.Lock()


def program() -> Path:
    """Rerun's own program.

    Raises:
        ViewError: it is not installed.
    """
    spec = find_spec("rerun_cli")
    for place in (spec.submodule_search_locations or []) if spec is not None else []:
        for name in ("rerun", "rerun.exe"):
            if (Path(place) / name).is_file():
                return Path(place) / name
    raise ViewError("Rerun is not installed.", "Install the package rerun-sdk.")


def _fetch(folder: Path, home: Path) -> None:
    own = {"HOME": str(home), "XDG_CONFIG_HOME": str(home / "config"), "XDG_DATA_HOME": str(home / "data")}
    environment = {**os.environ, **own, "NO_COLOR": "1"}
    quiet = [str(program()), "analytics", "disable"]
    subprocess.run(quiet, stdin=subprocess.DEVNULL, capture_output=True, env=environment, timeout=START_S, check=False)
    options = ("--serve-web", "--bind", "127.0.0.1", "--port", "auto", "--web-viewer-port", "0")
    with (home / "log").open("w+b") as log:
        process = subprocess.Popen(
            [program(), *options], stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=environment, cwd=home
        )
        try:
            address = _address(process, home / "log")
            for name in NAMES:
                _keep(f"{address}/{name}", folder / f"{name}.gz")
        finally:
            process.kill()
            process.wait()


def _address(process: subprocess.Popen[bytes], log: Path) -> str:
    """Address at which the viewer is served, as printed by the program."""
    waiting = threading.Event()
    for _ in range(int(START_S / 0.05)):
        text = re.sub(r"\x1b\[[0-9;]*m", "", log.read_text(errors="replace"))
        match = re.search(r"web-viewer at (http://127\.0\.0\.1:\d+)", text)
        if match:
            return match[1]
        if process.poll() is not None:
            break
        waiting.wait(0.05)
    lines = log.read_text(errors="replace").strip().splitlines()
    raise ViewError("Rerun's program did not start its viewer.", lines[-1][:200] if lines else "Try again in a moment.")


def _keep(address: str, path: Path) -> None:
    with urllib.request.urlopen(address, timeout=60) as answer:
        data = answer.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise ViewError("The viewer of the installed Rerun is too large.", "Install the version that imuscope names.")
    write_atomic(path, gzip.compress(data, COMPRESSION_LEVEL, mtime=0))
