"""Locations of protocol and rig files, and of new runs."""

import re
from pathlib import Path

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import translate_os_errors
from rfca_rig.suggestions import suggestion

PACKAGE = Path(__file__).parents[1]


def find_file(kind: str, name: str) -> Path:
    """The TOML file called `name`: a path as given, else `kind`/name.toml here, else the one that came with the package.

    `kind` is "protocols" or "calibration".
    """
    if name.endswith(".toml") or "/" in name:
        return Path(name)
    folders = folders_of(kind)
    for folder in folders:
        if (folder / f"{name}.toml").is_file():
            return folder / f"{name}.toml"
    known = sorted({file.stem for folder in folders if folder.is_dir() for file in folder.glob("*.toml")})
    meant = suggestion(name, known)
    raise BadInput(f"{kind}/{name}.toml: no such file; {meant}{'' if meant.endswith('?') else ', or give a path to a .toml file'}")


def folders_of(kind: str) -> list[Path]:
    """Folders in which files of that kind are searched, in this order."""
    # The user's own folder wins over the checkout, and that over the installed copies.
    return [Path(kind), PACKAGE.parent / kind, PACKAGE / "shipped" / kind]


def make_run_folder(parent: Path, mark: str, title: str) -> Path:
    """Make the next folder that does not exist yet: runs/SIM-title-001, -002 and so on.

    Making it claims it: of two runs that begin at the same moment, one gets the next number.
    """
    # Only characters that every file system and shell takes as they are.
    slug = re.sub(r"[^a-z0-9.]+", "-", title.lower()).strip("-")
    for number in range(1, 1_000_000):
        folder = parent / f"{mark}-{slug}-{number:03d}"
        with translate_os_errors(folder, "cannot be made"):
            try:
                folder.mkdir(parents=True)
            except FileExistsError:
                continue
        return folder
    raise BadInput(f"{parent}: holds a million runs called {mark}-{slug}; choose another folder with --runs")
