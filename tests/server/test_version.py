"""The commit that `imuscope --version` names: from git in a checkout, from a file elsewhere."""

import subprocess
from pathlib import Path

import pytest

from imuscope.server.version import COMMIT_FILE, VERSION, commit, described

GIT = ["git", "-c", "user.name=A", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]


def git(folder: Path, *words: str) -> str:
    return subprocess.check_output([*GIT, *words], cwd=folder, text=True).strip()


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A repository with one commit and a tag; returns its server/."""
    (tmp_path / "server").mkdir()
    (tmp_path / "server" / "a.py").write_text("1")
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "--quiet", "-m", "One")
    git(tmp_path, "tag", "-a", "v0.1.0", "-m", "0.1.0")
    return tmp_path / "server"


def test_a_checkout_names_its_commit_and_whether_files_differ(checkout: Path) -> None:
    head = git(checkout, "rev-parse", "--short=8", "HEAD")
    (checkout / COMMIT_FILE).write_text("of an older build\n")
    assert commit(checkout) == head
    (checkout / "a.py").write_text("2")
    assert commit(checkout) == f"{head}-dirty"


def test_an_installation_names_the_commit_that_it_was_built_from(tmp_path: Path) -> None:
    (tmp_path / COMMIT_FILE).write_text("12345678\n")
    assert commit(tmp_path) == "12345678"


def test_an_environment_within_another_checkout_does_not_name_its_commit(checkout: Path) -> None:
    installed = checkout.parent / ".venv" / "imuscope" / "server"
    installed.mkdir(parents=True)
    assert commit(installed) == ""


def test_without_git_only_the_version_is_printed(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert commit(checkout) == ""
    assert described() == f"imuscope {VERSION}"
