"""Files outside a folder of recordings: refused, unless the user allows them.

A folder from a stranger may hold links to any file of its reader, and models that name such files.
What a command then prints or writes, even the message about a file that it cannot read, would show
their content.
"""

from collections.abc import Iterable
from pathlib import Path

from rfca_rig.errors import BadInput

ALLOW_OUTSIDE = "--allow-outside"


def refuse_outside(files: Iterable[Path], folders: Iterable[Path]) -> None:
    """Raises BadInput for the first file that lies in none of the folders once all links are
    followed, or that is in a folder of links.
    """
    roots = [_resolve(folder) for folder in folders]
    for file in files:
        target = _resolve(file)
        if not any(target.is_relative_to(root) for root in roots):
            raise BadInput(
                f"{file}: leads to {target}, outside {roots[0]}, and is not read; put a "
                "copy into the folder, "
                f"or give {ALLOW_OUTSIDE}, which import, check, report, fit and diagnose "
                "take, if you trust who made the folder"
            )


def _resolve(path: Path) -> Path:
    """Where a path leads; of a link to itself, the root of all folders."""
    try:
        return path.resolve()
    # A RuntimeError before Python 3.13.
    except (OSError, RuntimeError):
        return Path(path.absolute().anchor)
