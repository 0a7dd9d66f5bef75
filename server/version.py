"""Version of this imuscope, and the commit it was made from.

The version is the installed package's; from a bare source tree, the one in pyproject.toml. The commit is read from git
in a checkout. A wheel and a source distribution that were built in a checkout have it in `commit.txt` beside this file
(web/build.py, which runs this file for it: nothing but the standard library is imported here).
"""

import subprocess
import tomllib
from importlib import metadata
from pathlib import Path

COMMIT_FILE = "commit.txt"
_HERE = Path(__file__).resolve().parent
_GIT_S = 5.0  # git may wait for a slow file system; a version without the commit is better than none


def _version() -> str:
    try:
        return metadata.version("imuscope")
    except metadata.PackageNotFoundError:
        with (_HERE.parent / "pyproject.toml").open("rb") as file:
            return str(tomllib.load(file)["project"]["version"])


VERSION = _version()


def commit(folder: Path = _HERE) -> str:
    """Commit in short, with "-dirty" when files differ from it; "" if it is not known.

    Args:
        folder: server/ of a checkout or of an installation. Only its own checkout is read: an environment may be in a
            checkout of something else.
    """
    if not (folder.parent / ".git").exists():
        try:
            return (folder / COMMIT_FILE).read_text(encoding="utf-8").strip()
        except OSError:
            return ""
    # Without --exclude a tag would take the place of the commit.
    command = ["git", "-C", str(folder.parent), "describe", "--always", "--abbrev=8", "--dirty", "--exclude=*"]
    try:
        result = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=_GIT_S)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return result.stdout.strip() if result.returncode == 0 else ""


def described() -> str:
    """Name, version and commit: "imuscope 0.2.0 (abc12345)"."""
    known = commit()
    return f"imuscope {VERSION} ({known})" if known else f"imuscope {VERSION}"
