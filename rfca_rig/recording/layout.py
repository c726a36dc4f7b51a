"""The files of a run's folder.

run.json        written first: title, source, what was believed, provenance, plan
events.jsonl    one JSON object a line, only ever added to
stages/0001.h5  a stage that is done, whole or cut short; written beside, forced to disk, renamed
stages/0002.journal  the stage in progress, see `journal`
end.json        how the run ended, and the static stages with what their photos showed
run.h5          all of it in one file, made of the others at the end
SHA256SUMS      of all of them, as sha256sum writes and checks them
"""

from pathlib import Path

HEADER = "run.json"
EVENTS = "events.jsonl"
STAGES = "stages"
ENDING = "end.json"
RECORDING = "run.h5"
SUMS = "SHA256SUMS"
PENDULUM = "pendulum.toml"  # describes recordings of a pendulum, which every command reads as they stand
EXPERIMENT = "experiment.toml"  # describes recordings of a mechanism, in files of any kind
DIAGNOSIS = "diagnosis.json"  # of a diagnosis's folder
BALLAST = ".ballast"
JOURNAL = ".journal"
STAGE = ".h5"
WRITING = ".writing"


def stage_files(folder: Path) -> list[Path]:
    """Of the stages that are done, in their order."""
    return sorted((folder / STAGES).glob(f"*{STAGE}"), key=_number)


def journals(folder: Path) -> list[Path]:
    """Of stages that are not done, in their order: at most one, unless a disk was full."""
    return sorted((folder / STAGES).glob(f"*{JOURNAL}"), key=_number)


def next_number(folder: Path) -> int:
    """Of the stage that comes next."""
    return max((_number(file) for file in (*stage_files(folder), *journals(folder))), default=0) + 1


def stage_path(folder: Path, number: int) -> Path:
    return folder / STAGES / f"{number:04d}{STAGE}"


def journal_path(folder: Path, number: int) -> Path:
    return folder / STAGES / f"{number:04d}{JOURNAL}"


def _number(file: Path) -> int:
    return int(file.stem)
