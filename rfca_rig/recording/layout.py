"""The files of a run's folder.

run.json        written first: title, source, nominal model, provenance, plan
events.jsonl    one JSON object a line, append-only
stages/0001.h5  a stage that is done, complete or cut short; written beside, forced to disk, renamed
stages/0002.journal  the stage in progress, see `journal`
end.json        how the run ended, and the static stages with the angles read from their photos
run.h5          all of it in one file, made of the others at the end
SHA256SUMS      of all of them, in the format of sha256sum
"""

from pathlib import Path

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


def stage_files(folder: Path) -> list[Path]:
    """Files of the stages that are done, in order."""
    return sorted((folder / STAGES).glob(f"*{STAGE}"), key=_number)


def journals(folder: Path) -> list[Path]:
    """Journals of stages that are not done, in order: at most one, unless a disk was full."""
    return sorted((folder / STAGES).glob(f"*{JOURNAL}"), key=_number)


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
