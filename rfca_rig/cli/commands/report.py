"""rfca-rig report"""

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import (
    AllowOutside,
    AsIs,
    Figures,
    Json,
    Model,
    PageCopies,
    Pdf,
    out_folder,
)
from rfca_rig.cli.terminal import echo
from rfca_rig.escaping import json_text

if TYPE_CHECKING:
    from rfca_rig.analysis.acceptance import AcceptanceTests
    from rfca_rig.reports.problems import ComparisonOptions, WrittenComparison


class ShaftOption(StrEnum):
    """How the simulated shaft turns."""

    average = "average"
    commanded = "commanded"
    recorded = "recorded"


def report(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="PATH",
            help=(
                "Campaign folders, imported or run folders, .h5 files; or one with experiment.toml."
            ),
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="DIR",
            callback=out_folder,
            help="Folder for report.html, run.html, their tables.",
        ),
    ] = Path("report"),
    shaft: Annotated[
        ShaftOption | None,
        typer.Option(
            "--shaft",
            metavar="HOW",
            help=(
                "Motion of the shaft to simulate with: average (the mean measured speed, as "
                "in the paper; the default), commanded (the default where --model has an effect "
                "of the drive), recorded."
            ),
        ),
    ] = None,
    model: Model = None,
    accept: Annotated[
        Path | None,
        typer.Option(
            "--accept",
            metavar="FILE",
            help=(
                "Test the model on every stroke with the tolerances of this file (schema "
                "tolerances); exit code 1 where a test fails."
            ),
        ),
    ] = None,
    as_is: AsIs = False,
    allow_outside: AllowOutside = False,
    pdf: Pdf = False,
    figures: Figures = False,
    as_json: Json = False,
) -> None:
    """Compare recordings with the model: Table II and overlays of measured and simulated force; and
    how each run went, in run.html.

    Of a mechanism or a pendulum: the signals of each recording, with nominal, fitted and held-out
    errors.

    Works offline, changes no recording.

    Example: rfca-rig report runs/SIM-table-ii-001 --out report
    """
    from rfca_rig.reports.problems import ComparisonOptions

    options = ComparisonOptions(shaft.value if shaft else None, model, as_is, accept)
    # First: a missing browser must be reported before the work, not after it.
    copies = PageCopies(pdf, figures)
    write(paths, out, options, as_json, quiet=as_json, copies=copies, allow_outside=allow_outside)


def write(
    paths: Sequence[Path],
    out: Path,
    options: "ComparisonOptions",
    as_json: bool,
    quiet: bool,
    copies: "PageCopies | None" = None,
    allow_outside: bool = False,
) -> None:
    """Writes the report and prints where it is.

    Parameters
    ----------
    paths : sequence of Path
        Recordings of one kind.
    out : Path
        Folder of the report.
    options : ComparisonOptions
        How the recordings are compared with the model.
    as_json : bool
        Print the comparison as JSON.
    quiet : bool
        Print nothing else.
    copies : PageCopies, optional
        What is made of the pages.
    allow_outside : bool
        Follow links to files outside a folder.
    """
    from rfca_rig.cli.progress import progress
    from rfca_rig.diagnosis.opening import open_problem
    from rfca_rig.reports.problems import write_comparison

    problem = open_problem(paths, options.as_is, allow_outside, options.model)
    with progress(quiet) as bars:
        written = write_comparison(problem, out, options, bars.share)
    if as_json:
        echo(json_text(_as_json(written)), nl=False)
    if not quiet:
        for line in written.lines:
            echo(line, err=True)
    if copies is not None:
        copies.make(written.pages, quiet)
    if written.tests is not None:
        _tell_outcome(written.tests, quiet)


def _as_json(written: "WrittenComparison") -> str:
    """The comparison, with the acceptance tests in it where there are any."""
    text = written.data.read_text(encoding="utf-8")
    if written.tests is None:
        return text
    import json

    from rfca_rig.reports.strokes.acceptance import acceptance_document

    document = {**json.loads(text), "acceptance": acceptance_document(written.tests)}
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def _tell_outcome(tests: "AcceptanceTests", quiet: bool) -> None:
    """Raises NotAccepted where a test failed."""
    from rfca_rig.errors import NotAccepted
    from rfca_rig.reports.strokes.acceptance import describe_outcome, list_failures

    outcome = describe_outcome(tests)
    if not quiet:
        for line in list_failures(tests):
            echo(line, err=True)
    if tests.failed:
        raise NotAccepted(outcome)
    if not quiet:
        echo(outcome, err=True)
