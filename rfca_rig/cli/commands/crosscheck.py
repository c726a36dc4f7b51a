"""rfca-rig crosscheck"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Json, Model, Rig, out_file
from rfca_rig.cli.terminal import echo, print_lines

if TYPE_CHECKING:
    from rfca_rig.analysis.crosscheck import CheckedCondition


def crosscheck(
    rig: Rig = "twin",
    model: Model = None,
    protocol: Annotated[
        str,
        typer.Option(
            "--protocol",
            metavar="NAME|FILE",
            help=(
                "A dynamic protocol, for its heights and speeds: a name (plan --list) or a "
                ".toml file."
            ),
        ),
    ] = "table2",
    picture: Annotated[
        Path | None,
        typer.Option(
            "--picture",
            metavar="FILE",
            callback=out_file,
            help="Draw both force curves and their difference: .svg, .png or .pdf.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Compare the model with MuJoCo, another group's multibody code, as the paper compares its
    model with RecurDyn.

    Example: rfca-rig crosscheck --picture crosscheck.svg
    """
    from rfca_rig.analysis.crosscheck import check_condition, check_own_contact
    from rfca_rig.analysis.mujoco_leg import load_mujoco
    from rfca_rig.cli.paths import find_file, find_rig
    from rfca_rig.cli.progress import announce_first_compile, progress
    from rfca_rig.description.model_file import read_model_file
    from rfca_rig.description.protocol_file import read_dynamic
    from rfca_rig.description.rig_file import read_rig
    from rfca_rig.errors import BadInput
    from rfca_rig.progress import iterate_with_progress
    from rfca_rig.reports.strokes.overlay import write_crosscheck_picture
    from rfca_rig.reports.style import check_picture_path

    # Before any work: MuJoCo is an extra that may not be installed.
    load_mujoco()
    if picture is not None:
        check_picture_path(picture)
    source = read_model_file(model) if model else read_rig(find_rig(rig))
    checked_model = source.model()
    # MuJoCo would simulate another leg, and the difference would be taken for an error of the
    # model.
    if checked_model.effects:
        raise BadInput(
            f"{model or rig}: has effects switched on; MuJoCo computes the plain leg and ground "
            "only, take the [[effects]] out"
        )
    plan = read_dynamic(find_file("protocols", protocol))
    conditions = plan.flapping().conditions
    with progress(as_json) as bars:
        announce_first_compile(bars, as_json)
        alike = bars.counting("the same contact in both")
        own_count = bars.counting("MuJoCo's own contact")
        same_ground = [
            check_condition(checked_model, condition, plan.sweep_deg)
            for condition in iterate_with_progress(conditions, alike)
        ]
        own_contact = [
            check_own_contact(checked_model, condition, plan.sweep_deg)
            for condition in iterate_with_progress(conditions, own_count)
        ]
    if picture is not None:
        write_crosscheck_picture(same_ground, picture)
    _say(same_ground, own_contact, as_json)


def _say(
    same_ground: "list[CheckedCondition]", own_contact: "list[CheckedCondition]", as_json: bool
) -> None:
    import json

    from rfca_rig.analysis.crosscheck import PAPER_PCT, STIFFENING_FACTOR, average_pct

    if as_json:
        answer = {
            "average_contact_force_difference_pct": round(average_pct(same_ground), 5),
            "paper_against_recurdyn_pct": PAPER_PCT,
            "same_ground": [condition.summary() for condition in same_ground],
            "own_contact_on_stiff_ground": [condition.summary() for condition in own_contact],
        }
        echo(json.dumps(answer, indent=1))
        return
    echo(f"contact force, difference from MuJoCo\n{_table(same_ground)}", nl=False)
    echo(
        f"average {average_pct(same_ground):.3f} %; the paper's model and RecurDyn: {PAPER_PCT:g} %"
    )
    print_lines(
        [
            (
                f"with MuJoCo's own contact, ground {STIFFENING_FACTOR:g} times as stiff "
                "(touchdown and release depend on the law of contact):"
            )
        ]
    )
    echo(_table(own_contact), nl=False)


def _table(checked: "list[CheckedCondition]") -> str:
    """A line for each condition; of one that never reaches a valley the loading is not known."""
    from rfca_rig.reports.table import Table, TableColumn, TableRow, as_text

    columns = (
        TableColumn("condition"),
        TableColumn("whole_stroke_pct", digits=3),
        TableColumn("loading_pct", digits=3),
    )
    rows = (
        {
            "condition": condition.label,
            "whole_stroke_pct": condition.stroke_pct,
            "loading_pct": condition.loading_pct,
        }
        for condition in checked
    )
    return as_text(Table("crosscheck", "", columns, tuple(TableRow(row) for row in rows)))
