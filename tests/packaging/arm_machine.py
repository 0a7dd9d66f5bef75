"""A 64-bit ARM machine in a folder, run by emulation: Debian's Python for arm64, imuscope's locked packages for
aarch64, and qemu's user mode, which runs a single program.

    apt, with folders of its own   qemu-user-static (this machine's), python3.11 and its libraries (arm64)
    uv                             the packages of a smaller installation, as wheels for aarch64

Nothing of this machine is changed; all is in the cache folder, and is made once for each lock file.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.support.cache_folder import cache_folder
from tests.support.source_files import ROOT

RELEASE = "bookworm"  # its Python is 3.11
SOURCE = f"deb [trusted=yes] http://deb.debian.org/debian {RELEASE} main\n"
ARM = (
    *(
        "python3.11-minimal",
        "libpython3.11-minimal",
        "libpython3.11-stdlib",
        "libc6",
        "libgcc-s1",
        "libstdc++6",
        "zlib1g",
    ),
    *("libexpat1", "libssl3", "libffi8", "libsqlite3-0", "libbz2-1.0", "liblzma5", "libuuid1", "libcrypt1", "libdb5.3"),
)
HOST = ("qemu-user-static",)
COMMAND_S = 900


class NoEmulationError(Exception):
    """The machine cannot be made here; the message says why."""


class ArmMachine:
    """The machine, made when it is not there yet.

    Raises:
        NoEmulationError: apt or the packages cannot be had.
    """

    def __init__(self) -> None:
        text = (ROOT / "uv.lock").read_bytes() + Path(__file__).read_bytes()
        self.folder = cache_folder("arm64") / hashlib.sha256(text).hexdigest()[:16]
        if not (self.folder / "ready").exists():
            shutil.rmtree(self.folder, ignore_errors=True)
            self.folder.mkdir(parents=True)
            self._unpack("amd64", HOST, self.folder / "host")
            self._unpack("arm64", ARM, self.folder / "root")
            self._install()
            (self.folder / "ready").touch()

    def command(self, *arguments: str | Path) -> list[str]:
        """A command of its Python."""
        root = self.folder / "root"
        emulator = self.folder / "host/usr/bin/qemu-aarch64-static"
        return [str(emulator), "-L", str(root), str(root / "usr/bin/python3.11"), *map(str, arguments)]

    @property
    def environment(self) -> dict[str, str]:
        """Variables of its programs. Paths are this machine's: the emulator looks into the root only for libraries."""
        paths = (ROOT, self.folder / "packages")
        return {
            **{name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "LD_"))},
            "PYTHONPATH": os.pathsep.join(map(str, paths)),
            "PYTHONHOME": str(self.folder / "root/usr"),
            "PYTHONDONTWRITEBYTECODE": "1",  # the source is shared with this machine
            "QEMU_LD_PREFIX": str(self.folder / "root"),
        }

    def run(self, *arguments: str | Path, cwd: Path = ROOT) -> str:
        """Run its Python to the end; returns what it prints. AssertionError: it fails."""
        done = subprocess.run(
            self.command(*arguments),
            cwd=cwd,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=COMMAND_S,
            check=False,
        )
        assert done.returncode == 0, done.stderr[-4000:]
        return done.stdout

    def _unpack(self, architecture: str, packages: Sequence[str], into: Path) -> None:
        """Fetch packages of Debian and unpack them."""
        place = self.folder / f"apt-{architecture}"
        for name in ("state/lists/partial", "cache/archives/partial", "etc"):
            (place / name).mkdir(parents=True, exist_ok=True)
        (place / "etc/sources.list").write_text(SOURCE)
        (place / "state/status").touch()
        options = {
            "APT::Architecture": architecture,
            "APT::Architectures": architecture,
            "Dir::State": place / "state",
            "Dir::State::status": place / "state/status",
            "Dir::Cache": place / "cache",
            "Dir::Etc::sourcelist": place / "etc/sources.list",
            "Dir::Etc::sourceparts": "-",
        }
        apt = ["apt-get", "-q", *(f"-o{name}={value}" for name, value in options.items())]
        downloads = place / "downloads"
        downloads.mkdir()
        self._call([*apt, "update"], downloads)
        self._call([*apt, "download", *packages], downloads)
        for file in sorted(downloads.glob("*.deb")):
            self._call(["dpkg-deb", "-x", str(file), str(into)], downloads)
        shutil.rmtree(place)

    def _install(self) -> None:
        """Install the packages that imuscope needs."""
        uv = [sys.executable, "-m", "uv"]
        expected = self.folder / "requirements.txt"
        export = ("export", "-q", "--no-dev", "--no-group", "complete", "--no-emit-project", "--no-hashes")
        self._call([*uv, *export, "-o", str(expected)], ROOT)
        where = ("--target", str(self.folder / "packages"), "--python-platform", "aarch64-manylinux_2_36")
        self._call(
            [
                *uv,
                "pip",
                "install",
                "-q",
                *where,
                "--python-version",
                "3.11",
                "--only-binary",
                ":all:",
                "-r",
                str(expected),
            ],
            ROOT,
        )

    def _call(self, command: Sequence[str], cwd: Path) -> None:
        try:
            subprocess.run(command, cwd=cwd, check=True, capture_output=True, text=True, timeout=COMMAND_S)
        except FileNotFoundError as error:
            raise NoEmulationError(f"{error.filename} is not here") from None
        except subprocess.CalledProcessError as error:
            raise NoEmulationError(f"{' '.join(command[:3])}: {error.stderr.strip()[-300:]}") from None
