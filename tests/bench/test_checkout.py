"""The state of the source: a revision that git itself tells, a change that is noticed, and no
checkout that is none.
"""

import shutil
import subprocess
from pathlib import Path

import pytest

from rfca_rig.bench.provenance import source_state

pytestmark = pytest.mark.skipif(shutil.which("git") is None, reason="no git here")


def git(folder: Path, *words: str) -> str:
    who = [
        "-c",
        "user.name=somebody",
        "-c",
        "user.email=somebody@example.org",
        "-c",
        "commit.gpgsign=false",
    ]
    return subprocess.run(
        ["git", *who, *words], cwd=folder, capture_output=True, text=True, check=True
    ).stdout.strip()


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    package = tmp_path / "rig"
    package.mkdir()
    (package / "code.py").write_text("a = 1\n")
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "--quiet", "-m", "first")
    return package


def test_a_clean_checkout_says_its_revision(checkout: Path):
    assert source_state(checkout) == {
        "git_revision": git(checkout, "rev-parse", "HEAD"),
        "git_dirty": "no",
    }


def test_a_changed_file_is_dirt_and_an_unknown_one_is_not(checkout: Path):
    (checkout / "results.txt").write_text("1\n")
    assert source_state(checkout)["git_dirty"] == "no"
    (checkout / "code.py").write_text("a = 2\n")
    assert source_state(checkout) == {
        "git_revision": git(checkout, "rev-parse", "HEAD"),
        "git_dirty": "yes",
    }


def test_what_is_installed_elsewhere_is_no_checkout(tmp_path: Path):
    assert source_state(tmp_path / "rig") == {
        "git_revision": "not a checkout",
        "git_dirty": "not a checkout",
    }


def test_a_git_that_cannot_be_run_is_told_and_stops_nothing(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("PATH", "")
    assert source_state(checkout) == {"git_revision": "unknown", "git_dirty": "unknown"}
