"""rfca-rig plan"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rfca_rig.cli.options import Json, Model, Rig
from rfca_rig.cli.terminal import echo, print_lines

if TYPE_CHECKING:
    from rfca_rig.cli.run_config import RunConfig
    from rfca_rig.protocol.check import Load
    from rfca_rig.protocol.plan import Plan, Stage

MOST_LINES = 60
# Column at which the last field begins.
LABEL_AT = 35


# Column at which the title begins in the list of names.
TITLE_AT = 28


def _list_names(wanted: bool) -> None:
    if wanted:
        print_lines(_names(), indent=" " * TITLE_AT)
        raise typer.Exit


def plan(
    protocol: Annotated[
        str,
        typer.Argument(metavar="PROTOCOL", help="A name in protocols/ (--list), or a .toml file."),
    ],
    rig: Rig = "twin",
    model: Model = None,
    lists: Annotated[  # noqa: ARG001
        bool,
        typer.Option(
            "--list",
            callback=_list_names,
            is_eager=True,
            help="Print the names of protocols and rigs, and leave.",
        ),
    ] = False,
    every: Annotated[
        bool,
        typer.Option("--all", help=f"Print every stage, also of a plan of more than {MOST_LINES}."),
    ] = False,
    as_json: Json = False,
) -> None:
    """Print every stage of a plan with its time, size and expected load, and check it against the
    rig's limits. Nothing moves.

    It is the very list that a run walks.

    Example: rfca-rig plan table2 --rig calibration/my-rig.toml
    """
    from rfca_rig.cli.progress import make_marked_say
    from rfca_rig.cli.run_config import RunOptions, make_run_config
    from rfca_rig.cli.run_experiment import check_before_run
    from rfca_rig.description.protocol_file import read_plan

    config = make_run_config(RunOptions(rig, protocol, model, Path("runs"), is_dry=True), read_plan)
    expected = check_before_run(config, make_marked_say(config.mark, as_json))
    if as_json:
        echo(json.dumps(_as_data(config.plan, expected), indent=1))
        return
    max_lines: int | None = MOST_LINES
    if every:
        max_lines = None
    lines = _lines(config, expected, max_lines)
    print_lines(
        (f"{config.mark} {line}" for line in lines), indent=f"{config.mark} " + " " * LABEL_AT
    )


def _names() -> Iterator[str]:
    """Names in protocols/ and calibration/, each with its kind and title."""
    from rfca_rig.cli.names import file_names, rig_names

    for heading, kind, known in (
        ("protocols", "protocols", file_names("protocols")),
        ("rigs", "calibration", rig_names()),
    ):
        yield f"{heading}:"
        for name in known:
            yield f"  {name:<18}{_kind_and_title(kind, name)}"


def _kind_and_title(folder: str, name: str) -> str:
    from rfca_rig.cli.paths import find_file
    from rfca_rig.errors import BadInput
    from rfca_rig.suggestions import in_one_line
    from rfca_rig.toml import read_data

    try:
        data = read_data(find_file(folder, name))
    # One broken file must not hide the others.
    except BadInput as error:
        return in_one_line(str(error))
    if isinstance(data.get("rig"), dict):
        head = data["rig"]
    else:
        head = data
    kind_key = "experiment"
    if folder == "calibration":
        kind_key = "kind"
    kind = in_one_line(str(head.get(kind_key, "")))
    title = in_one_line(str(head.get("title", "")))
    return f"{kind:<8}{title}"


def _lines(config: "RunConfig", expected: "Mapping[Stage, Load]", most: int | None) -> list[str]:
    plan = config.plan
    head = [
        f"{config.rig.rig.title}: {plan.title}",
        f"{'stage':>5} {'until':>9}  {'MB':>5} {'N':>5} {'N m':>5}  what",
    ]
    rows = _rows(plan, expected)
    if most is None or len(rows) <= most:
        shown = rows
    else:
        shown = [*rows[:most], f"... {len(rows) - most} stages more; --all prints them"]
    limits = plan.limits
    counted = (
        f"{len(plan.stages)} stages: {len(plan.flaps)} strokes, {len(plan.holds)} static stages"
    )
    at_most = (
        f"at most {_clock(plan.duration_s)} on the rig, {plan.recorded_bytes / 1e6:.1f} MB "
        "before compression and photos"
    )
    expects = "until: at most so long; N, N m: the most that the model expects"
    within = (
        f"within the limits: {limits.force_N:g} N, {limits.torque_Nm:g} N m, "
        f"{limits.speed_rad_s:g} rad/s"
    )
    return [*head, *shown, expects, counted, at_most, within]


def _rows(plan: "Plan", expected: "Mapping[Stage, Load]") -> list[str]:
    # Durations are upper bounds, so the running sum is the latest time at which a stage may end.
    rows = []
    until_s = 0.0
    for number, stage in enumerate(plan.stages, start=1):
        until_s += stage.duration_s
        size_MB = plan.rates.bytes_in(stage.recorded_s) / 1e6
        size = ""
        if size_MB:
            size = f"{size_MB:.1f}"
        rows.append(
            f"{number:5d} {_clock(until_s):>9}  {size:>5} {_load(expected.get(stage))}  "
            f"{stage.label}"
        )
    return rows


def _load(load: "Load | None") -> str:
    if load is None:
        return " " * 11
    return f"{load.force_N:5.0f} {load.torque_Nm:5.1f}"


def _clock(duration_s: float) -> str:
    """Hours, minutes and seconds, with as few fields as possible."""
    minutes, seconds = divmod(duration_s, 60.0)
    hours, minutes = divmod(int(minutes), 60)
    if hours:
        return f"{hours}:{minutes:02d}:{seconds:04.1f}"
    return f"{minutes}:{seconds:04.1f}"


def _as_data(plan: "Plan", expected: "Mapping[Stage, Load]") -> dict[str, Any]:
    stages = []
    for stage in plan.stages:
        force_N = None
        torque_Nm = None
        if load := expected.get(stage):
            force_N = load.force_N
            torque_Nm = load.torque_Nm
        stages.append(
            {
                "stage": type(stage).__name__,
                "label": stage.label,
                "at_most_s": stage.duration_s,
                "recorded_bytes": plan.rates.bytes_in(stage.recorded_s),
                "expected_force_N": force_N,
                "expected_torque_Nm": torque_Nm,
            }
        )
    return {
        "title": plan.title,
        "experiment": plan.experiment,
        "at_most_s": plan.duration_s,
        "stages": stages,
    }
