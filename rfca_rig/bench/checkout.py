"""The state of the source that this program runs from: git revision and local changes."""

import os
import subprocess
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
WITHIN_S = 5.0
NOT_A_CHECKOUT = "not a checkout"
UNKNOWN = "unknown"
_STATUS = ("git", "status", "--porcelain=v2", "--branch", "--untracked-files=no")
_REVISION = "# branch.oid "


def source_state(package: Path = PACKAGE) -> dict[str, str]:
    """Git revision, and whether tracked files were changed since; plain words where there is no checkout, or git fails.

    Takes some hundredths of a second, so it is called when a run begins and not when the program starts.
    """
    root = package.parent
    if not (root / ".git").exists():
        return {"git_revision": NOT_A_CHECKOUT, "git_dirty": NOT_A_CHECKOUT}
    lines = _status_lines(root)
    revision = next((line.removeprefix(_REVISION) for line in lines if line.startswith(_REVISION)), UNKNOWN)
    changed = "yes" if any(not line.startswith("#") for line in lines) else "no"
    return {"git_revision": revision, "git_dirty": changed if lines else UNKNOWN}


def _status_lines(root: Path) -> list[str]:
    """Lines of git status; none where git is missing, slow, or mistrusts another user's folder. The run goes on without."""
    # Without optional locks git status only reads: it does not disturb a git command that runs meanwhile.
    environment = {**os.environ, "GIT_OPTIONAL_LOCKS": "0"}
    try:
        finished = subprocess.run(_STATUS, cwd=root, env=environment, capture_output=True, text=True, timeout=WITHIN_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return []
    return finished.stdout.splitlines()
