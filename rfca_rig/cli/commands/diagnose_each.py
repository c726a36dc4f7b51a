"""rfca-rig diagnose --each: many recordings, a separate diagnosis of each."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from rfca_rig.cli.executors import open_executor
from rfca_rig.progress import ProgressReport

if TYPE_CHECKING:
    from rfca_rig.executors.mapping import TaskExecutor

ANSWER = "diagnosis.json"

Job = Callable[[tuple[Path, Path]], str | None]


def diagnose_each(paths: Sequence[Path], out: Path, job: Job, workers: int | None, cluster: str | None, as_json: bool) -> None:
    """A folder for each path under `out`; an existing one stays. Raises RigError where some could not be diagnosed.

    `job` makes one diagnosis of (recordings, folder), and returns the reason where the recordings cannot be used.
    """
    from rfca_rig.cli.progress import progress
    from rfca_rig.errors import RigError, Stopped
    from rfca_rig.recording.atomic import refresh_nfs_cache, remove_leftovers

    folders = _folders(paths, out)
    out.mkdir(parents=True, exist_ok=True)
    remove_leftovers(out)
    try:
        with progress(quiet=as_json) as bars, open_executor(workers, cluster, bars.report, out) as executor:
            failed = _diagnose_all(folders, job, executor, bars.report)
    except KeyboardInterrupt:
        raise Stopped("stopped by the operator; the same command goes on where it stood") from None
    # Workers on other computers wrote the answers; this computer may not see the new folders yet.
    refresh_nfs_cache(out)
    answers = {name: json.loads((out / name / ANSWER).read_text(encoding="utf-8")) for name in folders if name not in failed}
    if as_json:
        typer.echo(json.dumps(answers, indent=1))
    else:
        for name, answer in answers.items():
            typer.echo(f"{name}: {_in_words(answer)}")
    if failed:
        name, why = min(failed.items())
        raise RigError(f"{len(failed)} of {len(folders)} could not be diagnosed, as {name}: {why}")


def _folders(paths: Sequence[Path], out: Path) -> dict[str, tuple[Path, Path]]:
    """For each name the path of its recordings, and the folder of its diagnosis."""
    from rfca_rig.errors import BadInput

    folders: dict[str, tuple[Path, Path]] = {}
    for path in paths:
        name = path.resolve().parent.name if path.is_file() else path.resolve().name
        if name in folders:
            raise BadInput(f"{path}: {folders[name][0]} is called {name} too, and --each gives a folder to each name; rename one of them")
        folders[name] = (path.resolve(), out.resolve() / name)
    return folders


def _diagnose_all(
    folders: dict[str, tuple[Path, Path]], job: Job, executor: "TaskExecutor", report_progress: ProgressReport
) -> dict[str, str]:
    """Diagnoses what is missing; returns the reason, by name, for each that failed."""
    from rfca_rig.executors.mapping import TaskFailure, map_unordered

    to_do = [each for each in folders.values() if not (each[1] / ANSWER).is_file()]
    before = len(folders) - len(to_do)
    failed: dict[str, str] = {}
    report_progress("diagnoses", before, len(folders))
    for number, ((_, into), result) in enumerate(map_unordered(executor, job, to_do), start=before + 1):
        why = result.reason if isinstance(result, TaskFailure) else result
        if why is not None:
            failed[into.name] = why
        report_progress("diagnoses", number, len(folders))
    return failed


def _in_words(answer: dict[str, Any]) -> str:
    named = [f"{effect['id']} ({100.0 * effect['probability']:.1f} %)" for effect in answer["effects"]]
    # Files of rfca-diagnosis/1 have no grades.
    return ", ".join([answer.get("grade", answer["verdict"]), *named])
