"""Pages about a problem of the diagnosis, whatever the kind of its rig: where it comes from, and
its recordings beside the model.

A new kind of rig registers its own `origin_of_problem` and `write_comparison`.
"""

from dataclasses import dataclass
from functools import singledispatch
from pathlib import Path

from rfca_rig.analysis.acceptance import AcceptanceTests
from rfca_rig.analysis.compare import Table2
from rfca_rig.analysis.matched_simulation import Shaft
from rfca_rig.description.model_file import read_model_file
from rfca_rig.description.tolerances_file import read_tolerances
from rfca_rig.diagnosis.inference.model_selection import Progress
from rfca_rig.diagnosis.leg.problem import LegProblem
from rfca_rig.diagnosis.mechanisms.fit import compare_mechanism
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.diagnosis.problem import Problem, Row, refuse_leg_options
from rfca_rig.diagnosis.reference.problem import ReferenceProblem
from rfca_rig.model.catalogue import catalogue
from rfca_rig.progress import ignore_share
from rfca_rig.reports.provenance import Origin, command_line, origin_of, origin_of_import
from rfca_rig.reports.strokes.motions import JSON, PAGE, mechanism_report, write_motions
from rfca_rig.reports.strokes.page import GivenModel, write_report
from rfca_rig.reports.text import count_noun

SHAFT_IN_SHORT = {
    "average": "at its average speed",
    "commanded": "as commanded",
    "recorded": "as recorded",
}


@dataclass(frozen=True)
class ComparisonOptions:
    """How recordings are compared with the model.

    Parameters
    ----------
    shaft
        How the simulated shaft of a leg turns; None for the average speed of the strokes, or as
        commanded where the model has an effect of the drive.
    model
        A model file in place of the nominal model.
    as_is
        Values that are probably in another unit were taken.
    accept
        A tolerances file: the model is tested on every stroke of a leg.
    """

    shaft: Shaft | None = None
    model: Path | None = None
    as_is: bool = False
    accept: Path | None = None


@dataclass(frozen=True)
class WrittenComparison:
    """A written comparison.

    Parameters
    ----------
    pages
        Its pages, the one to open first.
    data
        The same for programs.
    lines
        What was written, in words.
    rows
        Measured beside simulated, for a table: a row per condition of a leg, per signal of each
        recording of a mechanism.
    tests
        Acceptance tests of a leg, where they were asked for.
    """

    pages: tuple[Path, ...]
    data: Path
    lines: tuple[str, ...]
    rows: tuple[Row, ...]
    tests: AcceptanceTests | None = None


@singledispatch
def origin_of_problem(problem: Problem, command: str) -> Origin:
    """Origin of a page about a problem, made by a command line. Raises OSError."""
    raise NotImplementedError(type(problem))


@origin_of_problem.register
def _(problem: LegProblem, command: str) -> Origin:
    return origin_of(command, problem.paths, problem.recordings_of_leg)


@origin_of_problem.register
def _(problem: MechanismProblem, command: str) -> Origin:
    experiment = problem.experiment
    return origin_of_import(command, experiment.path.parent, experiment.title, experiment.about)


@origin_of_problem.register
def _(problem: ReferenceProblem, command: str) -> Origin:
    return origin_of_problem(problem.new, command)


@singledispatch
def write_comparison(
    problem: Problem,
    out: Path,
    options: ComparisonOptions,
    progress: Progress = ignore_share,
) -> WrittenComparison:
    """Compare recordings with their model, and write the pages into `out`, which is made.

    Parameters
    ----------
    problem
        The recordings.
    out
        Folder of the report.
    options
        Motion and model.
    progress
        Called with what is being done and the share that is done.

    Raises
    ------
    BadInput
        Where an option does not apply to this kind of rig, or recordings and model do not fit.
    SimulationFailed
        Where the model cannot be simulated.
    RigError
        Where a file cannot be written.
    """
    raise NotImplementedError(type(problem))


@write_comparison.register
def _(
    problem: LegProblem,
    out: Path,
    options: ComparisonOptions,
    progress: Progress = ignore_share,
) -> WrittenComparison:
    model = options.model
    given = GivenModel(model.name, read_model_file(model).model()) if model else None
    typed: dict[str, object] = {
        "--shaft": options.shaft,
        "--model": model,
        "--as-is": options.as_is,
        "--accept": options.accept,
    }
    tolerances = None
    if options.accept is not None:
        tolerances = read_tolerances(options.accept)
    recordings = problem.recordings_of_leg
    command = command_line("report", *problem.paths, options=typed)
    shaft = options.shaft or _choose_shaft(given)
    written = write_report(
        recordings,
        out,
        shaft,
        given,
        origin_of(command, problem.paths, recordings),
        lambda done, of: progress("conditions", done / of),
        tolerances,
    )
    is_listening = all(recording.is_listening for recording in recordings)
    lines = _describe_pages(written.table, out, len(recordings), shaft, is_listening)
    rows = _list_valleys(written.table)
    return WrittenComparison(tuple(written.pages), out / "table2.json", lines, rows, written.tests)


def _choose_shaft(given: GivenModel | None) -> Shaft:
    """At its average recorded speed, as the paper does. Where the model has an effect of the drive,
    as commanded: the recorded motion has that effect already.
    """
    if given is None:
        return "average"
    places = [catalogue()[present.id].where for present in given.rig.effects]
    return "commanded" if "drive" in places else "average"


def _list_valleys(table: Table2) -> tuple[Row, ...]:
    """The rows of Table II with their units in the names."""
    return tuple(
        {
            "height_mm": round(1e3 * row.height_m, 6),
            "speed_rad_s": row.speed_rad_s,
            "repeats": row.repeats,
            "measured_time_s": row.time.mean,
            "measured_fz_N": row.fz.mean,
            "simulated_time_s": row.simulated_time_s,
            "simulated_fz_N": row.simulated_fz_N,
            "time_error_pct": row.time_error_pct,
            "force_error_pct": row.force_error_pct,
        }
        for row in table.rows
    )


def _describe_pages(
    table: Table2, out: Path, runs: int, shaft: Shaft, is_listening: bool
) -> tuple[str, ...]:
    """The pages, the most informative one first."""
    lines: list[str] = []
    if table.rows:
        if table.average_time_error_pct is None or table.average_force_error_pct is None:
            averages = "no condition with a measured and a simulated valley"
        else:
            averages = (
                f"{len(table.rows)} conditions, average error of the valley "
                f"{table.average_time_error_pct:.1f} % in time, "
                f"{table.average_force_error_pct:.1f} % in force, shaft {SHAFT_IN_SHORT[shaft]}"
            )
        lines.append(f"{out / 'report.html'}: {averages}")
    if is_listening:
        lines.append("recorded without motion: there is nothing to compare with a model")
    if runs == 1:
        lines.append(f"{out / 'run.html'}: how the run went")
    else:
        lines.append(f"{out / 'run-1.html'} to run-{runs}.html: how the runs went")
    return tuple(lines)


@write_comparison.register
def _(
    problem: MechanismProblem,
    out: Path,
    options: ComparisonOptions,
    progress: Progress = ignore_share,
) -> WrittenComparison:
    refuse_leg_options(
        {
            "--shaft": options.shaft is not None,
            "--as-is": options.as_is,
            "--accept": options.accept is not None,
        }
    )
    comparison = compare_mechanism(problem.experiment, progress)
    folder = problem.experiment.path.parent
    command = command_line("report", folder, options={"--model": options.model})
    report = mechanism_report(problem.experiment, comparison)
    write_motions(report, comparison.fit, out, origin_of_problem(problem, command))
    recordings = count_noun(len({error.run for error in comparison.fit.errors}), "recording")
    line = f"{out / PAGE}: measured and simulated signals of {recordings}"
    rows = tuple(vars(error) for error in comparison.fit.errors)
    return WrittenComparison((out / PAGE,), out / JSON, (line,), rows)
