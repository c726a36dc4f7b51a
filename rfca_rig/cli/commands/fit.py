"""rfca-rig fit"""

import json
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.commands.report import ShaftOption, refuse_leg_options
from rfca_rig.cli.names import FIT_PARAMETERS
from rfca_rig.cli.options import AllowOutside, AsIs, Cluster, Json, open_executor, out_file
from rfca_rig.cli.terminal import echo, print_lines

if TYPE_CHECKING:
    from rfca_rig.analysis.fitting.result import FitResult
    from rfca_rig.diagnosis.window_fit import WindowFit


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
    import numpy as np

    from rfca_rig.analysis.fitting.fit import Search
    from rfca_rig.analysis.fitting.parameters import select_parameters
    from rfca_rig.analysis.fitting.residuals import StrokeWindow
    from rfca_rig.analysis.fitting.result import write_model_file
    from rfca_rig.analysis.fitting.strokes import StrokeComparison, fit_recordings
    from rfca_rig.campaign.opening import experiment_among, open_with_nominal_model
    from rfca_rig.cli.progress import progress
    from rfca_rig.errors import BadInput

    mechanism = experiment_among(paths)
    if effects and mechanism is None:
        raise BadInput(
            "--effects: is an option for recordings of a mechanism (experiment.toml); "
            "leave it out here"
        )
    if mechanism is not None:
        # An option counts as given where it differs from its default.
        asked = {
            "--shaft": shaft != ShaftOption.recorded,
            "--phases": phases != "loading",
            "--after-touchdown": after_touchdown != 200.0,
        }
        refuse_leg_options({**asked, "--starts": starts != 1, "--cluster": cluster is not None})
        _fit_mechanism(
            mechanism, _names(parameters), _names(effects), out, as_is, allow_outside, as_json
        )
        return
    comparison = StrokeComparison(
        shaft.value, StrokeWindow(tuple(_names(phases)), 1e-3 * after_touchdown)
    )
    # Only for its check: a misspelt parameter must be refused before the recordings are read.
    select_parameters(_names(parameters))
    recordings = open_with_nominal_model(paths, as_is, allow_outside)
    counter = _Counter()
    # Without a cluster there is no executor: threads of this process share out one descent better
    # than processes share several.
    with (
        progress(quiet=as_json) as bars,
        open_executor(None, cluster, bars.report)
        if cluster is not None
        else nullcontext() as executor,
    ):
        bars.show_unbounded("fitting", counter.text)
        search = Search(
            starts=starts,
            rng=np.random.default_rng(seed),
            progress=counter.count,
            executor=executor,
        )
        result = fit_recordings(recordings, _names(parameters), comparison, search)
    if out is not None:
        sources = [
            f"{path} ({recording.source}): {recording.title}"
            for path, recording in zip(paths, recordings, strict=True)
        ]
        write_model_file(out, result, recordings[0].nominal, recordings[0].known_to, sources)
    _print(result, out, as_json)


def _fit_mechanism(
    folder: Path,
    names: list[str],
    effects: list[str],
    out: Path | None,
    as_is: bool,
    allow_outside: bool,
    as_json: bool,
) -> None:
    """The same for recordings of a mechanism or a pendulum, with the named effects."""
    from rfca_rig.campaign.opening import open_experiment
    from rfca_rig.campaign.pendulum import FILE_NAME as PENDULUM
    from rfca_rig.campaign.pendulum import write_fitted_pendulum
    from rfca_rig.cli.progress import progress
    from rfca_rig.diagnosis.mechanisms.fit import MECHANISM_FIT, fit_mechanism
    from rfca_rig.errors import BadInput
    from rfca_rig.mechanism.model_files import write_amended_model

    is_pendulum = (folder / PENDULUM).is_file()
    as_toml = is_pendulum and out is not None and out.suffix == ".toml"
    if out is not None and out.suffix != ".xml" and not as_toml:
        raise BadInput(f"{out}: the model of a mechanism is MJCF; name a file that ends with .xml")
    experiment = open_experiment(folder, allow_outside)
    with progress(quiet=as_json) as bars:
        mechanism_fit = fit_mechanism(experiment, bars.share, names, effects, as_is)
    if out is not None and as_toml:
        comments = [f"Fitted to {folder} (IMPORT): {experiment.title}", *mechanism_fit.fit.lines()]
        shifts = {shift.name: (shift.value, shift.std) for shift in mechanism_fit.fit.shifts}
        write_fitted_pendulum(out, folder, shifts, comments)
    elif out is not None:
        beyond = write_amended_model(mechanism_fit.plant, out)
        if beyond:
            echo(f"{out}: MJCF does not hold {', '.join(beyond)}; see the fitted values", err=True)
    _print_windows(mechanism_fit.fit, MECHANISM_FIT, folder, out, as_json)


def _print_windows(
    window_fit: "WindowFit", file_format: str, folder: Path, out: Path | None, as_json: bool
) -> None:
    """Prints a fit to windows of recordings."""
    if as_json:
        echo(json.dumps(window_fit.plain(file_format), indent=1))
        return
    print_lines(window_fit.lines())
    if out is not None:
        echo(
            f"{out}: the fitted model; rfca-rig report {folder} --model {out} compares it", err=True
        )


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _print(result: "FitResult", out: Path | None, as_json: bool) -> None:
    if as_json:
        echo(json.dumps(result.plain(), indent=1))
        return
    print_lines(result.lines())
    if out is not None:
        echo(f"{out}: the fitted model", err=True)


class _Counter:
    """Progress of a search, whose number of evaluations is not known beforehand."""

    def __init__(self) -> None:
        self._text = ""

    def count(self, simulated: int, chi2: float) -> None:
        self._text = f"{simulated} sets of values, chi2 {chi2:.0f}"

    def text(self) -> str:
        return self._text
