"""rfca-rig record"""

from pathlib import Path
from typing import Annotated

import typer

from rfca_rig.cli.options import Json, Operator, Rig, Sample, Seed, out_folder
from rfca_rig.cli.terminal import echo


def record(
    rig: Rig = "twin",
    seconds: Annotated[
        float | None,
        typer.Option(
            "--seconds",
            metavar="S",
            min=0.01,
            max=604_800.0,
            help="Time to record; until ^C if not given, at most a week.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            callback=out_folder,
            help="New folder of the run; the next one in runs if not given.",
        ),
    ] = None,
    pace: Annotated[
        float,
        typer.Option(
            "--pace",
            metavar="X",
            min=0.0,
            help="A twin runs at X times real time at most; 0 is full speed.",
        ),
    ] = 1.0,
    seed: Seed = None,
    operator: Operator = "",
    sample: Sample = "",
    as_json: Json = False,
) -> None:
    """Record the devices of a rig without any motion: reports of the motor, of the force sensor,
    and every frame on the CAN bus. The motor is never enabled, commanded or disabled.

    A rig file with [rig] and one of [motor] and [force_sensor] is enough. ^C ends the recording,
    which is whole then.

    Example: rfca-rig record --rig REAL.toml --seconds 60
    """
    import json

    from rfca_rig.cli.listen import ListeningOptions, record_listening

    asked = ListeningOptions(rig, seconds, out, pace, seed, operator, sample, is_quiet=as_json)
    heard = record_listening(asked)
    if as_json:
        answer = {"source": heard.mark, "run": str(heard.folder), "ended": heard.why}
        echo(json.dumps({**answer, "samples": dict(heard.samples)}, indent=1))
        return
    counts = ", ".join(f"{count} {name}" for name, count in heard.samples.items())
    echo(
        f"{heard.mark} recorded {counts} in {heard.folder}; next: rfca-rig export csv "
        f"{heard.folder} --out {heard.folder.name}",
        err=True,
    )
