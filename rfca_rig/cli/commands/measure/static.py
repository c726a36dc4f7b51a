"""rfca-rig static"""

import math
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rfca_rig.cli.options import (
    AllowOutside,
    AsIs,
    Command,
    Dry,
    Fault,
    Figures,
    Json,
    Model,
    Operator,
    Pace,
    Pdf,
    Protocol,
    Rig,
    Runs,
    Sample,
    Seed,
    View,
    ViewPort,
    out_file,
    out_folder,
)
from rfca_rig.cli.terminal import echo, print_lines

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rfca_rig.analysis.static_forces import FoundTipForce
    from rfca_rig.analysis.torque_rotation.static_result import StaticResult
    from rfca_rig.bench.recorder import Recorder
    from rfca_rig.cli.terminal import Say
    from rfca_rig.model.parameters import Leg
    from rfca_rig.protocol.plan import Stage
    from rfca_rig.recording.model import Recording, StaticStage


Angles = Annotated[
    str | None,
    typer.Option(
        "--angles",
        metavar="DEG,DEG,...",
        help="The shaft from the horizontal, then each hinge, instead of a run.",
    ),
]

app = typer.Typer(
    help="The static experiment: turn the shaft in stages, let the leg settle, measure.",
    no_args_is_help=True,
)

HINGE_STD = typer.Option(
    "--hinge-std-deg",
    metavar="DEG",
    min=1e-4,
    max=10,
    help="One standard deviation of a hinge angle, where the stages do not say.",
)
MARKS = typer.Option(
    "--marks-deg",
    metavar="DEG",
    min=0,
    max=5,
    help="How far a hinge's zero may be off because marks sit beside their axes: 0.36 for 0.1 mm.",
)
# Defaults of options, which the command in the report's footer leaves out.
USUAL = {"--marks-deg": 0.36, "--force-gain-pct": 0.0}
GAIN = typer.Option(
    "--force-gain-pct",
    metavar="PERCENT",
    min=0,
    max=20,
    help="One standard deviation of the force sensor's gain; 0 counts as exact.",
)


def load(
    down: Annotated[
        float,
        typer.Option("--down", metavar="N", min=-1e4, max=1e4, help="Force on the tip, downwards."),
    ] = 0.0,
    along: Annotated[
        float,
        typer.Option(
            "--along", metavar="N", min=-1e4, max=1e4, help="Force on the tip, away from the shaft."
        ),
    ] = 0.0,
    shaft: Annotated[
        float,
        typer.Option(
            "--shaft", metavar="DEG", min=-360, max=360, help="Shaft below the horizontal."
        ),
    ] = 0.0,
    rig: Rig = "twin",
    model: Model = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            "--picture",
            metavar="FILE",
            callback=out_file,
            help="Draw the shape: .svg, .png or .pdf.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """The leg's shape and the torques of its hinges under a force at the tip, the shaft held; no
    floor, the weight counts.

    Example: rfca-rig static load --shaft 30 --down -20 --picture load.svg
    """
    import json

    import numpy as np

    from rfca_rig.analysis.static_forces import load_tip
    from rfca_rig.reports.style import check_picture_path

    if picture is not None:
        check_picture_path(picture)
    shape = load_tip(_leg(rig, model), float(np.radians(shaft)), np.array([along, down]))
    if picture is not None:
        from rfca_rig.reports.static.pictures import write_tip_load_picture

        write_tip_load_picture(shape, picture)
    if as_json:
        echo(json.dumps(shape.summary(), indent=1))
    else:
        print_lines(shape.lines())


def force(
    run: Annotated[
        Path | None,
        typer.Argument(
            metavar="RUN", help="A run or campaign folder with photographed static stages."
        ),
    ] = None,
    angles: Angles = None,
    angle_std: Annotated[
        float,
        typer.Option(
            "--angle-std",
            metavar="DEG",
            min=1e-4,
            max=10,
            help="One standard deviation of an angle that says none.",
        ),
    ] = 0.1,
    rig: Rig = "twin",
    model: Model = None,
    as_json: Json = False,
) -> None:
    """The force at the tip from the leg's shape, as a photo gives it; beside what the sensor felt,
    where a run has both.

    Only the tip may touch anything. A run's own leg counts, or that of --model; for --angles that
    of --rig.

    Example: rfca-rig static force --angles 30,-4.1,-4.9,-5.1,-4.6,-3.4,-1.8
    """
    import json

    import numpy as np

    from rfca_rig.analysis.static_forces import find_tip_force
    from rfca_rig.errors import BadInput

    if (run is None) == (angles is None):
        raise BadInput("static force takes either a run or --angles; give one of them")
    rows: list[tuple[str, FoundTipForce, tuple[float, float] | None]] = []
    if angles is not None:
        shape = [np.radians(angle) for angle in _numbers(angles)]
        rows.append(
            (
                "these angles",
                find_tip_force(_leg(rig, model), shape, float(np.radians(angle_std))),
                None,
            )
        )
    else:
        from rfca_rig.campaign.opening import open_recordings
        from rfca_rig.description.model_file import nominal_model
        from rfca_rig.model.parameters import GRAVITY_M_S2

        assert run is not None
        recordings = open_recordings([run])
        leg = nominal_model(read_nominal_values(recordings, model)[0]).leg
        weight_N = GRAVITY_M_S2 * sum(leg.link_masses_kg)
        for stage in (stage for recording in recordings for stage in recording.static):
            # One unknown hinge angle leaves the whole shape undetermined.
            if not np.isfinite(stage.hinge_deg).all():
                continue
            stds = [std for std in stage.hinge_std_deg if np.isfinite(std)]
            # `find_tip_force` takes one standard deviation for all angles: their root mean square.
            std_deg = angle_std
            if stds:
                std_deg = float(np.sqrt(np.mean(np.square(stds))))
            std = float(np.radians(std_deg))
            label = (
                f"stage {stage.stage}, {1e3 * stage.height_m:.0f} mm, shaft "
                f"{np.degrees(stage.shaft_angle_rad):.1f} deg"
            )
            shape = [stage.shaft_angle_rad, *np.radians(stage.hinge_deg)]
            # From the sensor's force to that at the tip: reversed along the ground, and without the
            # leg's weight, which the sensor carries too.
            rows.append(
                (label, find_tip_force(leg, shape, std), (-stage.fy_N, stage.fz_N - weight_N))
            )
        if not rows:
            raise BadInput(
                f"{run}: has no static stage with all hinge angles; give --angles, or "
                "record with a camera"
            )
    if as_json:
        echo(json.dumps([_summary(*row) for row in rows], indent=1))
    else:
        print_lines(_line(*row) for row in rows)


def _leg(rig: str, model: Path | None) -> "Leg":
    from rfca_rig.cli.paths import find_rig
    from rfca_rig.description.model_file import read_model_file
    from rfca_rig.description.rig_file import read_rig

    if model is not None:
        return read_model_file(model).model().leg
    return read_rig(find_rig(rig)).model().leg


def _numbers(text: str) -> list[float]:
    from rfca_rig.errors import BadInput

    try:
        angles = [float(part) for part in text.split(",")]
    except ValueError:
        angles = [float("nan")]
    if not all(math.isfinite(angle) for angle in angles):
        raise BadInput(
            f"--angles {text!r}: takes numbers in degrees with commas between them, as "
            "30,-4,-5,-5,-5,-3,-2"
        )
    if any(abs(angle) > 360.0 for angle in angles):
        raise BadInput(f"--angles {text!r}: an angle is beyond a whole turn, 360 degrees")
    return angles


def _line(label: str, tip_force: "FoundTipForce", felt_N: "tuple[float, float] | None") -> str:
    from rfca_rig.reports.diagnosis.tables import STDS_90

    components = zip(tip_force.force_N, tip_force.std_N, ("along", "down"), strict=True)
    parts = [f"{force:+.2f} +- {STDS_90 * std:.2f} N {way}" for force, std, way in components]
    felt = ""
    if felt_N is not None:
        felt = f"; the sensor felt {felt_N[0]:+.2f} and {felt_N[1]:+.2f} N"
    return (
        f"{label}: {', '.join(parts)} (90 %){felt}; hinge moments are left open by "
        f"{tip_force.residual_Nm:.2g} N m at most"
    )


def _summary(
    label: str, tip_force: "FoundTipForce", felt_N: "tuple[float, float] | None"
) -> dict[str, object]:
    return {
        "of": label,
        "force_N": tip_force.force_N.tolist(),
        "std_N": tip_force.std_N.tolist(),
        "residual_Nm": tip_force.residual_Nm,
        "felt_N": None if felt_N is None else list(felt_N),
    }


def photos(
    run: Annotated[
        Path,
        typer.Argument(
            metavar="RUN",
            help="The recording whose stages they are of: a run, or a campaign's folder.",
        ),
    ],
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="PHOTOS", help="A folder with one photo for each stage, named in their order."
        ),
    ],
    camera: Annotated[
        Path,
        typer.Option(
            "--camera",
            metavar="FILE",
            help="The camera they were taken with, as calibrate camera wrote it.",
        ),
    ] = Path("calibration/camera.toml"),
    mark_diameter: Annotated[
        float | None,
        typer.Option(
            "--mark-diameter",
            metavar="MM",
            min=1,
            max=100,
            help="Diameter of the red marks, where the run does not say.",
        ),
    ] = None,
    runs: Runs = Path("runs"),
) -> None:
    """Read hinge angles off photos taken by hand, or again with a better calibration; the recording
    with them goes into a new folder.

    Example: rfca-rig static photos runs/REAL-static-001 card/ --camera lab.toml
    """
    from dataclasses import replace
    from shutil import rmtree

    from rfca_rig.bench.stage_photos import eye_for, with_hand_photos
    from rfca_rig.campaign.opening import RECORDING_NAME, open_recordings
    from rfca_rig.cli.paths import make_run_folder
    from rfca_rig.cli.progress import progress
    from rfca_rig.drivers.photo_files import list_photos
    from rfca_rig.recording.store import write_recording
    from rfca_rig.toml import read_text

    (recording,) = open_recordings([run])
    files = list_photos(folder)
    eye = eye_for(recording, camera, mark_diameter)
    target = make_run_folder(runs, recording.source, recording.title)
    try:
        with progress(quiet=False) as bars:
            with_angles = with_hand_photos(
                recording, files, eye, target, bars.counting("reading photos")
            )
        sources = {"camera_file": read_text(camera), "photos_from": folder.resolve().name}
        write_recording(
            replace(with_angles, provenance={**with_angles.provenance, **sources}),
            target / RECORDING_NAME,
        )
    # A folder with photos but without a recording is of no use to any command.
    except BaseException:
        rmtree(target, ignore_errors=True)
        raise
    for line in photo_lines(with_angles.static):
        echo(f"{recording.source} {line}", err=True)
    echo(
        (
            f"{recording.source} {len(with_angles.static)} stages with their photos in "
            f"{target}; next: rfca-rig static report {target}"
        ),
        err=True,
    )


def photo_lines(stages: "Sequence[StaticStage]") -> "Iterator[str]":
    """A line for each photo: its hinge angles and doubts."""
    for stage in stages:
        if stage.photo:
            angles = " ".join(
                _with_std(*hinge)
                for hinge in zip(stage.hinge_deg, stage.hinge_std_deg, strict=True)
            )
            doubts = ""
            if stage.photo_doubts:
                doubts = f"; {stage.photo_doubts}"
            yield (
                f"{stage.photo}, stage {stage.stage} at {1e3 * stage.height_m:g} mm: hinges "
                f"{angles} deg{doubts}"
            )


def _with_std(angle_deg: float, std_deg: float) -> str:
    from math import isnan

    if isnan(angle_deg):
        return "?"
    return f"{angle_deg:.2f}+-{std_deg:.2f}"


@app.command(cls=Command)
def report(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="PATH", help="Campaign folders, imported or run folders, or .h5 files."
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="DIR",
            callback=out_folder,
            help="Folder for static.html, the tables and model.toml.",
        ),
    ] = Path("static-report"),
    model: Model = None,
    hinge_std_deg: Annotated[float | None, HINGE_STD] = None,
    marks_deg: Annotated[float, MARKS] = USUAL["--marks-deg"],
    force_gain_pct: Annotated[float, GAIN] = USUAL["--force-gain-pct"],
    as_is: AsIs = False,
    allow_outside: AllowOutside = False,
    pdf: Pdf = False,
    figures: Figures = False,
    as_json: Json = False,
) -> None:
    """The hinges' torque over rotation from photographed static stages: curve, stiffness, errors,
    checks, and a model file with them.

    Example: rfca-rig static report runs/REAL-static-001 --out static-report
    """
    import json

    from rfca_rig.cli.options import PageCopies
    from rfca_rig.reports.static.files import summary

    copies = PageCopies(pdf, figures)
    options = StaticReportOptions(
        model, hinge_std_deg, marks_deg, force_gain_pct, as_is, allow_outside
    )
    result = write(paths, out, options, as_json)
    if as_json:
        echo(json.dumps(summary(result), indent=1))
    else:
        _say(result, out)
    copies.make([out / "static.html"], as_json)


@dataclass(frozen=True)
class StaticReportOptions:
    """The options of `static report` as typed."""

    model: Path | None = None
    hinge_std_deg: float | None = None
    marks_deg: float = USUAL["--marks-deg"]
    force_gain_pct: float = USUAL["--force-gain-pct"]
    as_is: bool = False
    allow_outside: bool = False

    def typed(self) -> dict[str, object]:
        """Those that are not their defaults, for the command in the page's foot."""
        options: dict[str, object] = {
            "--model": self.model,
            "--hinge-std-deg": self.hinge_std_deg,
            "--marks-deg": self.marks_deg,
            "--force-gain-pct": self.force_gain_pct,
            "--as-is": self.as_is,
        }
        return {name: value for name, value in options.items() if value != USUAL.get(name)}


def write(
    paths: "Sequence[Path]", out: Path, options: StaticReportOptions, quiet: bool
) -> "StaticResult":
    """Finds the torque-rotation curve of the recordings' stages and writes its report."""
    from rfca_rig.analysis.torque_rotation.evaluate import StageAssumptions, evaluate
    from rfca_rig.analysis.torque_rotation.stages import Instruments
    from rfca_rig.campaign.opening import open_recordings
    from rfca_rig.cli.progress import progress
    from rfca_rig.reports.provenance import command_line, origin_of
    from rfca_rig.reports.static.files import write_static_report
    from rfca_rig.reports.static.tables import static_sources

    recordings = open_recordings(paths, options.as_is, options.allow_outside)
    command = command_line("static", "report", *paths, options=options.typed())
    nominal, known_to = read_nominal_values(recordings, options.model)
    instruments = Instruments(0.01 * options.force_gain_pct, options.marks_deg)
    with progress(quiet) as bars:
        result = evaluate(
            recordings,
            StageAssumptions(nominal, known_to, instruments, options.hinge_std_deg),
            bars.counting("solving"),
        )
    model_name = None
    if options.model:
        model_name = options.model.name
    write_static_report(
        result,
        static_sources(paths, recordings),
        out,
        nominal,
        known_to,
        model_name,
        origin_of(command, paths, recordings),
    )
    return result


def read_nominal_values(
    recordings: "Sequence[Recording]", model: Path | None
) -> "tuple[Mapping[str, Any], Mapping[str, Any]]":
    """Nominal model and known_to of the recordings, or of the model file. Raises BadInput where
    the recordings differ.
    """
    from rfca_rig.description.model_file import read_model_file
    from rfca_rig.errors import BadInput
    from rfca_rig.recording.model import refuse_other_nominal

    if model is not None:
        given = read_model_file(model)
        return given.nominal(), given.known_to.model_dump(exclude_none=True)
    first = recordings[0]
    # One evaluation has one nominal model.
    refuse_other_nominal(recordings, "give one model for both with --model")
    if not first.nominal:
        raise BadInput(f"{first.title!r} does not say what leg it is of; give a model with --model")
    return first.nominal, first.known_to


def _say(result: "StaticResult", out: Path) -> None:
    from rfca_rig.analysis.torque_rotation.static_result import remarks
    from rfca_rig.reports.static.files import choose_model_name, suggest_strokes
    from rfca_rig.reports.static.page import bend_sentence

    values = result.values
    for line in remarks(result):
        echo(line, err=True)
    echo(bend_sentence(result), err=True)
    echo(
        f"{out / 'static.html'}: k0 {values.k0_Nm_per_rad:.3f} +- "
        f"{values.reach * values.k0_std:.3f} N m/rad, "
        f"k2 {values.k2_per_rad2:.3f} +- {values.reach * values.k2_std:.3f} 1/rad2 (95 %)",
        err=True,
    )
    model_name = choose_model_name(result)
    if model_name:
        echo(f"next: {suggest_strokes(str(out / model_name))}", err=True)


app.command("photos", cls=Command)(photos)


app.command("load", cls=Command)(load)


app.command("force", cls=Command)(force)


@app.command(cls=Command)
def run(
    protocol: Protocol = "static-angle",
    rig: Rig = "twin",
    model: Model = None,
    camera: Annotated[
        Path | None,
        typer.Option(
            "--camera",
            metavar="FILE",
            help="A camera as calibrate camera wrote it, in place of the rig file's.",
        ),
    ] = None,
    runs: Runs = Path("runs"),
    seed: Seed = None,
    operator: Operator = "",
    sample: Sample = "",
    view: View = False,
    view_port: ViewPort = None,
    pace: Pace = 1.0,
    fault: Fault = None,
    dry_run: Dry = False,
    as_json: Json = False,
) -> None:
    """Go through the stages of a protocol at each of its heights; record force, shaft and hinge
    angles once they have settled.

    Example: rfca-rig static run --protocol bending
    """
    from rfca_rig.cli.attach_view import parse_viewing
    from rfca_rig.cli.run_config import RunOptions, make_run_config
    from rfca_rig.cli.run_experiment import run_and_record
    from rfca_rig.description.protocol_file import read_static
    from rfca_rig.protocol.experiments import static_plan

    viewing = parse_viewing(view, view_port, pace)
    asked = RunOptions(
        rig,
        protocol,
        model,
        runs,
        seed,
        operator,
        sample,
        is_dry=dry_run,
        is_quiet=as_json,
        viewing=viewing,
        faults=fault or (),
        camera=camera,
    )
    config = make_run_config(
        asked, lambda path, facts: static_plan(read_static(path).static_stages(), facts)
    )
    folder, recorder = run_and_record(config, say_stage)
    if folder is None or recorder is None:
        return
    if as_json:
        _print_json(config.mark, folder, recorder.stages)
    else:
        for line in photo_lines(recorder.stages):
            echo(f"{config.mark} {line}", err=True)
        if any(stage.overlay for stage in recorder.stages):
            following = f"static report {folder}"
        else:
            following = f"report {folder} --out report"
        echo(
            (
                f"{config.mark} recorded {len(recorder.stages)} stages in {folder}; next: "
                f"rfca-rig {following}"
            ),
            err=True,
        )


def say_stage(stage: "Stage", recorder: "Recorder", say: "Say") -> None:
    """Prints a line for every static stage."""
    from rfca_rig.protocol.plan import Hold

    if isinstance(stage, Hold):
        row = recorder.stages[-1]
        if row.settled:
            unsettled = ""
        else:
            unsettled = f", NOT SETTLED within {stage.settle.limit_s:g} s"
        if row.photo_doubts:
            no_photo = f", NO PHOTO: {row.photo_doubts}"
        else:
            no_photo = ""
        say(
            f"{stage.label}: fy {row.fy_N:.2f} N, fz {row.fz_N:.2f} N, tx {row.tx_Nm:.3f} "
            f"N m{unsettled}{no_photo}"
        )


def _print_json(mark: str, folder: Path, stages: "list[StaticStage]") -> None:
    import json

    rows = [
        {
            "height_mm": round(1e3 * stage.height_m, 6),
            "stage": stage.stage,
            "direction": stage.direction,
            "shaft_angle_rad": stage.shaft_angle_rad,
            "fy_N": stage.fy_N,
            "fz_N": stage.fz_N,
            "tx_Nm": stage.tx_Nm,
            "settled": stage.settled,
            "hinge_deg": _replace_nan(stage.hinge_deg),
            "hinge_std_deg": _replace_nan(stage.hinge_std_deg),
            "hinge_reading_std_deg": _replace_nan(stage.hinge_reading_std_deg),
            "photo": stage.photo,
            "overlay": stage.overlay,
            "photo_doubts": stage.photo_doubts,
        }
        for stage in stages
    ]
    echo(json.dumps({"source": mark, "run": str(folder), "stages": rows}, indent=1))


def _replace_nan(values: "Sequence[float]") -> list[float | None]:
    # JSON has no NaN; null stands for an unknown angle.
    return [None if isnan(value) else value for value in values]
