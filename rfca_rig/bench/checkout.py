"""Which state of its source this program runs from."""

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
    """Git revision, and whether files that it knows were changed since; words instead where there is no checkout, or git cannot tell.

    Costs some hundredths of a second; for when a run begins, not for when the program does.
    """
    root = package.parent
    if not (root / ".git").exists():
        return {"git_revision": NOT_A_CHECKOUT, "git_dirty": NOT_A_CHECKOUT}
    lines = _status_lines(root)
    revision = next((line.removeprefix(_REVISION) for line in lines if line.startswith(_REVISION)), UNKNOWN)
    changed = "yes" if any(not line.startswith("#") for line in lines) else "no"
    return {"git_revision": revision, "git_dirty": changed if lines else UNKNOWN}


def _status_lines(root: Path) -> list[str]:
    """Git may be missing, slow, or mistrust a folder of somebody else's: then it tells nothing, and the run goes on."""
    asking = {**os.environ, "GIT_OPTIONAL_LOCKS": "0"}
    try:
        said = subprocess.run(_STATUS, cwd=root, env=asking, capture_output=True, text=True, timeout=WITHIN_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return []
    return said.stdout.splitlines()
