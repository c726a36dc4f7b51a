"""The files of a run's folder.

run.json        written first: title, source, nominal model, provenance, plan
events.jsonl    one JSON object a line, append-only
stages/0001.h5  a stage that is done, complete or cut short; written beside, forced to disk, renamed
stages/0002.journal  the stage in progress, see `journal`
end.json        how the run ended, and the static stages with the angles read from their photos
run.h5          all of it in one file, made of the others at the end
SHA256SUMS      of all of them, in the format of sha256sum

The name of a recorded channel ends with its unit; axes and signs are those of the sensor (z down).

A recording's identity is the same wherever its files lie and whatever they are called.
"""

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath, PureWindowsPath

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import write_atomically

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
# Describes a campaign on a leg that was recorded elsewhere.
CAMPAIGN = "campaign.toml"
# The experiment of a recording that `record` made, without motion.
LISTENING = "listening"
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
    return sorted(
        (file for file in (folder / STAGES).glob(f"*{suffix}") if file.stem.isdecimal()),
        key=_number,
    )


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
        raise BadInput(
            f"{path}: has {size / 1e6:.0f} MB, where {MOST_TEXT_BYTES / 1e6:.0f} MB are the most"
        )
    return path.read_bytes()


def is_inside(name: str) -> bool:
    """Whether a path that a file states stays in the folder it belongs to, on any system."""
    paths = PurePosixPath(name), PureWindowsPath(name)
    return (
        not any(path.is_absolute() or path.drive or ".." in path.parts for path in paths)
        and "\0" not in name
    )


def refuse_links(folder: Path) -> None:
    """Raises BadInput where a file of the run in `folder` is a link that leads out of it, or
    neither file nor folder.

    A run from elsewhere could otherwise show any file of its reader, or a pipe that never ends.
    """
    refuse_links_among(folder, (HEADER, EVENTS, ENDING, RECORDING, SUMS, STAGES, PHOTOS, OVERLAYS))
    for name in (STAGES, PHOTOS, OVERLAYS):
        if (folder / name).is_dir():
            refuse_links_among(
                folder, (f"{name}/{file.name}" for file in (folder / name).iterdir())
            )


def refuse_links_among(folder: Path, names: Iterable[str]) -> None:
    """The same for these files of the folder alone."""
    root = folder.resolve()
    for name in names:
        file = folder / name
        if file.is_symlink() and not (_resolve(file).is_relative_to(root) and file.exists()):
            raise BadInput(
                f"{file}: is a link to elsewhere, which is not followed; put the file "
                "itself into its place"
            )
        if name in (STAGES, PHOTOS, OVERLAYS):
            kind = "folder"
            has_kind = file.is_dir()
        else:
            kind = "file"
            has_kind = file.is_file()
        if file.exists() and not has_kind:
            raise BadInput(f"{file}: is no {kind}; take it out of the run's folder")


def _resolve(link: Path) -> Path:
    """Where a link leads; the root of all folders where it leads to itself."""
    try:
        return link.resolve()
    except (OSError, RuntimeError):
        return Path(link.anchor or "/")


_HASH = re.compile("[0-9a-f]{64}")

DIGITS = 32
# Recordings from elsewhere, beside tables of comma-separated values: files of data loggers, logs of
# a CAN bus with the databases of their messages, and bags. zstd: files of a ROS 2 bag that were
# compressed as a whole.
KINDS_OF_RECORDINGS = (
    *("csv.gz", "tsv", "lvm", "h5", "hdf5", "mat"),
    *("tdms", "mf4", "mdf", "parquet", "feather"),
    *("blf", "asc", "log", "trc", "dbc", "kcd", "sym", "arxml"),
    *("mcap", "db3", "bag", "zstd"),
)


def write_sums(folder: Path, coming: Mapping[str, bytes] | None = None) -> None:
    """`SHA256SUMS`. `coming` has the content of files, by name, that will be written after it."""
    coming = coming or {}
    # Sorted, so that the same run gives the same bytes. The reserve is gone after the run, files
    # being written are not part of it, and links may show files of somebody else.
    files = sorted(
        file
        for file in folder.rglob("*")
        if file.is_file()
        and file.name not in (SUMS, BALLAST)
        and file.suffix != WRITING
        and not file.is_symlink()
    )
    names = {file: file.relative_to(folder).as_posix() for file in files}
    lines = (
        f"{hashlib.sha256(coming[name]).hexdigest()}  {name}"
        if name in coming
        else sum_line(file, folder)
        for file, name in names.items()
    )
    write_atomically(folder / SUMS, "".join(f"{line}\n" for line in lines).encode())


def sum_line(file: Path, folder: Path) -> str:
    """A file's line in the format of sha256sum, without the line end."""
    return f"{sha256_of(file)}  {file.relative_to(folder).as_posix()}"


def read_sums(folder: Path) -> dict[str, str]:
    """Hash by path in the folder; empty for a run that has not been finished. Raises BadInput
    for malformed lines.
    """
    path = folder / SUMS
    if not path.is_file():
        return {}
    sums: dict[str, str] = {}
    text = read_bounded(path).decode(errors="replace")
    # By line feeds alone: names may hold other characters that end a line elsewhere.
    *lines, behind = text.split("\n")
    for number, line in enumerate(lines, start=1):
        hashed, _, name = line.partition("  ")
        if not _HASH.fullmatch(hashed) or not is_inside(name) or not name or name in sums:
            raise BadInput(f"{path}:{number}: is no line of sha256sum for a file of this folder")
        sums[name] = hashed
    if behind:
        raise BadInput(f"{path}:{len(lines) + 1}: is cut short")
    return sums


def sha256_of(file: Path) -> str:
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


def identity_of(title: str, source: str, provenance: Mapping[str, str]) -> str:
    """32 hexadecimal digits from title, source and provenance. The provenance has the SHA-256 of
    the recorded files.

    A run that was continued or recovered has another identity than before.
    """
    # Sorted keys: the identity must not depend on the order of a dictionary.
    text = json.dumps([title, source, dict(provenance)], sort_keys=True, ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def list_described_files(folder: Path) -> list[Path]:
    """Of recordings from elsewhere: description, model file and recordings, sorted by name."""
    kinds: tuple[str, ...] = ("csv",)
    if (folder / EXPERIMENT).is_file() or (folder / CAMPAIGN).is_file():
        kinds = ("csv", *KINDS_OF_RECORDINGS)
    descriptions = (
        file for ending in ("toml", "xml", "urdf") for file in folder.glob(f"*.{ending}")
    )
    tables = (file for ending in kinds for file in folder.rglob(f"*.{ending}"))
    # A diagnosis that was written below the folder has tables of its own.
    files = (*descriptions, *(file for file in tables if not (file.parent / DIAGNOSIS).is_file()))
    # A pipe of such a name would be waited for.
    return sorted(file for file in files if file.is_file())


def identity_of_tables(title: str, folder: Path) -> str:
    """Identity of recordings from elsewhere that are read in place, a description and tables
    below `folder`. Raises OSError.
    """
    sums = "".join(f"{sum_line(file, folder)}\n" for file in list_described_files(folder))
    return identity_of(title, "IMPORT", {"sha256": hashlib.sha256(sums.encode()).hexdigest()})
