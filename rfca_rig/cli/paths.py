"""Locations of protocol and rig files, and of new runs.

Python files of own devices may run if this command line leads to them, or if they drove a run on
this computer before.

A rig file names Python files, and reading the rig executes them. A recording from elsewhere names a
rig file, and a folder from elsewhere may hold `calibration/twin.toml`, which a bare name finds
before the shipped one. Neither may execute a file that the user did not choose.
"""

import hashlib
import re
from contextlib import suppress
from pathlib import Path

import typer

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import translate_os_errors
from rfca_rig.suggestions import suggestion

# The camera of the twin, which its rig file names beside itself.
CAMERA_FILE = "twin-camera.toml"
SHIPPED_RIGS = ("twin", "twin-daq")
PACKAGE = Path(__file__).parents[1]

NAME = "trusted-code.txt"
SECTIONS = ("motor", "force_sensor")
FILE_KEYS = ("file", "twin_file")


def find_file(kind: str, name: str) -> Path:
    """The TOML file called `name`: a path as given, else `kind`/name.toml here, else the one that
    came with the package.

    `kind` is "protocols" or "calibration".
    """
    if name.endswith(".toml") or "/" in name:
        return Path(name)
    folders = folders_of(kind)
    for folder in folders:
        if (folder / f"{name}.toml").is_file():
            return folder / f"{name}.toml"
    known = sorted(
        {file.stem for folder in folders if folder.is_dir() for file in folder.glob("*.toml")}
    )
    hint = suggestion(name, known)
    if not hint.endswith("?"):
        hint += ", or give a path to a .toml file"
    raise BadInput(f"{kind}/{name}.toml: no such file; {hint}")


def folders_of(kind: str) -> list[Path]:
    """Folders in which files of that kind are searched, in this order."""
    # The user's own folder wins over the checkout, and that over the installed copies.
    return [Path(kind), PACKAGE.parent / kind, PACKAGE / "shipped" / kind]


def is_shipped(path: Path) -> bool:
    """Whether the rig file came with the package, so that no command may change it."""
    # A lab's own files may stand beside them in a clone.
    return path.stem in SHIPPED_RIGS and path.absolute().parent in folders_of("calibration")[1:]


def find_shipped(kind: str) -> Path:
    """The folder of that kind that came with the package, whatever the current folder holds."""
    return next(folder for folder in folders_of(kind)[1:] if folder.is_dir())


def refuse_shipped(path: Path) -> None:
    """Raises BadInput for a file inside the installed package, which is not to be changed."""
    if path.is_relative_to(PACKAGE):
        raise BadInput(f"{path}: came with the package; copy it, and give the path of the copy")


def check_writable(path: Path) -> None:
    """Raises BadInput where a file is there already, or has no folder."""
    if path.exists():
        raise BadInput(f"{path}: is there already; remove it, or name another file")
    if not path.parent.is_dir():
        raise BadInput(
            f"{path}: there is no folder {path.parent}; make it, or name a file in another folder"
        )


def write_twin_rig(path: Path, text: str) -> None:
    """Writes the rig file of a twin, and beside it the camera that it names, if none is there."""
    from rfca_rig.recording.atomic import write_atomically

    camera = path.parent / CAMERA_FILE
    if not camera.exists():
        write_atomically(camera, (find_shipped("calibration") / CAMERA_FILE).read_bytes())
    write_atomically(path, text.encode("utf-8"))


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
    raise BadInput(
        f"{parent}: holds a million runs called {mark}-{slug}; choose another folder with --runs"
    )


def find_rig(name: str) -> Path:
    """The rig file called `name`. Raises BadInput where a bare name leads to code in the current
    folder that never ran here.
    """
    path = find_file("calibration", name)
    if path.parent == Path("calibration") and path != Path(name):
        check_trusted(path, f"--rig {path}")
    return path


def check_trusted(rig_path: Path, remedy: str) -> None:
    """Raises BadInput, with what to type instead, where a rig file names code that is not
    trusted.
    """
    trusted = _read_trusted_hashes()
    for file in _code_of(rig_path):
        if _hash(file) not in trusted:
            raise BadInput(
                f"{rig_path}: would execute {file}, which never drove a run on this "
                f"computer; read it, then give {remedy}"
            )


def trust(rig_path: Path) -> None:
    """Adds the code of a rig file that drives a run. A folder that takes no file only means that
    `resume` asks for --rig.
    """
    new = {_hash(file) for file in _code_of(rig_path)} - _read_trusted_hashes()
    if new:
        with suppress(OSError):
            _list_file().parent.mkdir(parents=True, exist_ok=True)
            with _list_file().open("a", encoding="utf-8") as file:
                file.writelines(f"{digest}\n" for digest in sorted(new))


def _read_trusted_hashes() -> set[str]:
    if _list_file().is_file():
        return set(_list_file().read_text(encoding="utf-8").split())
    return set()


def _list_file() -> Path:
    return Path(typer.get_app_dir("rfca-rig")) / NAME


def _code_of(rig_path: Path) -> list[Path]:
    """The Python files that a rig file names, without reading any of them."""
    # Imported here, as pydantic would slow down --help and completions.
    from rfca_rig.toml import read_data

    data = read_data(rig_path)
    tables = [table for name in SECTIONS if isinstance(table := data.get(name), dict)]
    named = [table[key] for table in tables for key in FILE_KEYS if isinstance(table.get(key), str)]
    return [(rig_path.parent / file).resolve() for file in named]


def _hash(file: Path) -> str:
    """Of a file's content; of one that cannot be read, of nothing that could be in the list."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError:
        return ""
