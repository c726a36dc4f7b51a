"""rfca-rig check"""

from pathlib import Path
from typing import Annotated

import typer

from rfca_rig.cli.options import Json


def check(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of the run.")],
    as_json: Json = False,
) -> None:
    """Check a run on disk: every file by its hash, every stage by its counts, a line each. Exit code 2 where one is damaged.

    Example: rfca-rig check runs/REAL-flapping-001
    """
    import json

    from rfca_rig.cli.progress import progress
    from rfca_rig.errors import BadInput
    from rfca_rig.recording.checking import check_run

    findings = []
    with progress(as_json) as bars:
        done, of = 0.0, _size_MB(run)
        for finding in check_run(run):
            done += _size_MB(run / finding.file)
            bars.told("checking, MB", round(done), max(1, round(of)))
            findings.append(finding)
            if not as_json:
                typer.echo(f"{'ok     ' if finding.is_sound else 'DAMAGED'} {finding.file}: {finding.words}")
    if as_json:
        rows = [{"file": finding.file, "sound": finding.is_sound, "found": finding.words} for finding in findings]
        typer.echo(json.dumps({"run": str(run), "files": rows}, indent=1))
    damaged = [finding.file for finding in findings if not finding.is_sound]
    if damaged:
        raise BadInput(f"{run}: damaged: {', '.join(damaged)}; stage files that are sound can still make a run.h5: rfca-rig recover {run}")


def _size_MB(path: Path) -> float:
    """Of a file, or of all files in a folder."""
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file()) / 1e6
