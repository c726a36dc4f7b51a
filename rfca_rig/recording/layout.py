"""The files of a run's folder.

run.json        written first: title, source, nominal model, provenance, plan
events.jsonl    one JSON object a line, append-only
stages/0001.h5  a stage that is done, complete or cut short; written beside, forced to disk, renamed
stages/0002.journal  the stage in progress, see `journal`
end.json        how the run ended, and the static stages with the angles read from their photos
run.h5          all of it in one file, made of the others at the end
SHA256SUMS      of all of them, in the format of sha256sum

The name of a recorded channel ends with its unit; axes and signs are those of the sensor (z down).
"""

from collections.abc import Iterable
from pathlib import Path, PurePosixPath, PureWindowsPath

from rfca_rig.errors import BadInput

HEADER = "run.json"
EVENTS = "events.jsonl"
STAGES = "stages"
ENDING = "end.json"
RECORDING = "run.h5"
SUMS = "SHA256SUMS"
# Describes recordings of a pendulum, which every command reads in place.
PENDULUM = "pendulum.toml"
# Describes recordings of a mechanism, in files of any kind.
EXPERIMENT = "experiment.toml"
# In the folder of a diagnosis.
DIAGNOSIS = "diagnosis.json"
BALLAST = ".ballast"
JOURNAL = ".journal"
STAGE = ".h5"
WRITING = ".writing"
PHOTOS = "photos"
OVERLAYS = "overlays"
# Of each text. An event of a stage takes 300 bytes: room for 400 000 of them.
MOST_TEXT_BYTES = 128 << 20

SHAFT = ("shaft_angle_rad", "shaft_speed_rad_s", "motor_torque_Nm")
WRENCH = ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")
# Joint 1 is the motor shaft and has no hinge, so hinges are numbered from 2.
HINGES = tuple(f"hinge{i}_deg" for i in range(2, 8))

UNITS = {
    "t_s": "s",
    "host_s": "s",
    "shaft_angle_rad": "rad",
    "shaft_speed_rad_s": "rad/s",
    "motor_torque_Nm": "N m",
    **{name: name.split("_")[1].replace("Nm", "N m") for name in WRENCH},
    **dict.fromkeys(HINGES, "deg"),
}


def stage_files(folder: Path) -> list[Path]:
    """Files of the stages that are done, in order."""
    return _list_numbered(folder, STAGE)


def journals(folder: Path) -> list[Path]:
    """Journals of stages that are not done, in order: at most one, unless a disk was full."""
    return _list_numbered(folder, JOURNAL)


def _list_numbered(folder: Path, suffix: str) -> list[Path]:
    # Copies with other names, as file managers make them, are no stages.
    return sorted((file for file in (folder / STAGES).glob(f"*{suffix}") if file.stem.isdecimal()), key=_number)


def next_number(folder: Path) -> int:
    """Number of the next stage."""
    # Of journals too: a stage whose file is still to be made must keep its number.
    return max((_number(file) for file in (*stage_files(folder), *journals(folder))), default=0) + 1


def stage_path(folder: Path, number: int) -> Path:
    return folder / STAGES / f"{number:04d}{STAGE}"


def journal_path(folder: Path, number: int) -> Path:
    return folder / STAGES / f"{number:04d}{JOURNAL}"


def _number(file: Path) -> int:
    return int(file.stem)


def read_bounded(path: Path) -> bytes:
    """The bytes of a text of the run. Raises BadInput where it is larger than any run's."""
    if (size := path.stat().st_size) > MOST_TEXT_BYTES:
        raise BadInput(f"{path}: has {size / 1e6:.0f} MB, where {MOST_TEXT_BYTES / 1e6:.0f} MB are the most")
    return path.read_bytes()


def is_inside(name: str) -> bool:
    """Whether a path that a file states stays in the folder it belongs to, on any system."""
    paths = PurePosixPath(name), PureWindowsPath(name)
    return not any(path.is_absolute() or path.drive or ".." in path.parts for path in paths) and "\0" not in name


def refuse_links(folder: Path) -> None:
    """Raises BadInput where a file of the run in `folder` is a link that leads out of it, or neither file nor folder.

    A run from elsewhere could otherwise show any file of its reader, or a pipe that never ends.
    """
    refuse_links_among(folder, (HEADER, EVENTS, ENDING, RECORDING, SUMS, STAGES, PHOTOS, OVERLAYS))
    for name in (STAGES, PHOTOS, OVERLAYS):
        if (folder / name).is_dir():
            refuse_links_among(folder, (f"{name}/{file.name}" for file in (folder / name).iterdir()))


def refuse_links_among(folder: Path, names: Iterable[str]) -> None:
    """The same for these files of the folder alone."""
    root = folder.resolve()
    for name in names:
        file = folder / name
        if file.is_symlink() and not (_resolve(file).is_relative_to(root) and file.exists()):
            raise BadInput(f"{file}: is a link to elsewhere, which is not followed; put the file itself into its place")
        if file.exists() and not (file.is_dir() if name in (STAGES, PHOTOS, OVERLAYS) else file.is_file()):
            raise BadInput(f"{file}: is no {'folder' if name in (STAGES, PHOTOS, OVERLAYS) else 'file'}; take it out of the run's folder")


def _resolve(link: Path) -> Path:
    """Where a link leads; the root of all folders where it leads to itself."""
    try:
        return link.resolve()
    except (OSError, RuntimeError):
        return Path(link.anchor or "/")
