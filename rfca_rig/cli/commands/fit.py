"""rfca-rig fit"""

import json
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from rfca_rig.cli.commands.report import ShaftOption
from rfca_rig.cli.names import FIT_PARAMETERS
from rfca_rig.cli.options import AllowOutside, AsIs, Cluster, Json, open_executor, out_file
from rfca_rig.cli.terminal import echo, print_lines

HELP_PARAMETERS = (
    f"What to fit, out of {', '.join(FIT_PARAMETERS)}; of a mechanism or a pendulum names of its "
    "own. All that the section known_to lists if not given."
)
HELP_EFFECTS = (
    "Effects to put into the model of a mechanism, as joint_friction; diagnose --list prints all."
)
HELP_SHAFT = (
    "Motion of the shaft to simulate with: recorded, average (the mean measured speed), commanded."
)


def fit(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="PATH",
            help=(
                "Campaign folders, imported or run folders, .h5 files; or one with experiment.toml."
            ),
        ),
    ],
    parameters: Annotated[
        str, typer.Option("--parameters", metavar="NAME,...", help=HELP_PARAMETERS)
    ] = "",
    effects: Annotated[str, typer.Option("--effects", metavar="NAME,...", help=HELP_EFFECTS)] = "",
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            callback=out_file,
            help="Write the fitted model: .toml; of a mechanism MJCF, .xml; of a pendulum either.",
        ),
    ] = None,
    shaft: Annotated[
        ShaftOption, typer.Option("--shaft", metavar="HOW", help=HELP_SHAFT)
    ] = ShaftOption.recorded,
    phases: Annotated[
        str,
        typer.Option(
            "--phases",
            metavar="NAME,...",
            help="Phases to fit: free, touchdown, loading, release, rebound.",
        ),
    ] = "loading",
    after_touchdown: Annotated[
        float,
        typer.Option(
            "--after-touchdown",
            metavar="MS",
            min=0,
            max=5000,
            help="How much of the first contact to leave out.",
        ),
    ] = 200.0,
    starts: Annotated[
        int,
        typer.Option(
            "--starts",
            metavar="N",
            min=1,
            max=64,
            help="Begin from this many places, and tell how many agree.",
        ),
    ] = 1,
    seed: Annotated[
        int, typer.Option("--seed", metavar="N", min=0, help="Seed of the places to begin from.")
    ] = 0,
    cluster: Cluster = None,
    as_is: AsIs = False,
    allow_outside: AllowOutside = False,
    as_json: Json = False,
) -> None:
    """Fit values of the nominal model to recordings: values, standard errors, and values that the
    recordings cannot distinguish.

    By default from 200 ms after touchdown to the valley, where the model meets a leg that lacks
    nothing to the noise.

    Of a mechanism or a pendulum: the values that known_to lists, with errors on held-out
    conditions.

    Example: rfca-rig fit runs/SIM-table-ii-001 --parameters k0,friction
    """
    from rfca_rig.cli.progress import progress
    from rfca_rig.diagnosis.opening import open_problem
    from rfca_rig.diagnosis.problem import FitOptions

    options = FitOptions(
        _names(parameters),
        _names(effects),
        shaft.value,
        tuple(_names(phases)),
        1e-3 * after_touchdown,
        starts,
        seed,
        cluster,
    )
    problem = open_problem(paths, as_is, allow_outside)
    # Names and options are checked before the long fit.
    problem.check_fit(options, out)
    # Without a cluster there is no executor: threads of this process share out one descent better
    # than processes share several.
    with (
        progress(quiet=as_json) as bars,
        open_executor(None, cluster, bars.report)
        if cluster is not None
        else nullcontext() as executor,
    ):
        fitted = problem.fit(replace(options, executor=executor), bars.share)
    remarks = [] if out is None else fitted.write_model(out)
    for line in remarks:
        echo(line, err=True)
    if as_json:
        echo(json.dumps(fitted.plain(), indent=1))
        return
    print_lines(fitted.lines())
    if out is not None:
        typed = " ".join(map(str, paths))
        echo(
            f"{out}: the fitted model; rfca-rig report {typed} --model {out} compares it", err=True
        )


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]
