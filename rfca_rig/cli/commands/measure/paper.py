"""rfca-rig paper"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Json, Operator, Pdf, Rig, Sample, Seed, out_folder
from rfca_rig.cli.terminal import echo

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rfca_rig.analysis.reproduction import Reproduction
    from rfca_rig.analysis.torque_rotation.static_result import StaticResult
    from rfca_rig.description.rig_file import RigFile
    from rfca_rig.recording.model import Recording
    from rfca_rig.reports.paper.page import PaperContext, PaperStep

RUNS = "runs"
BOARD_PHOTOS = "board"
CAMERA = "camera.toml"
STATIC_REPORT = "static-report"
# Defaults of options, which the command in the page's foot leaves out.
USUAL = {
    "--rig": "twin",
    "--static-protocol": "static-angle",
    "--protocol": "table2",
    "--seed": None,
}
REPORT = "report"
DIAGNOSIS = "diagnosis"


def paper(
    paths: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="PATH",
            help=(
                "Recordings with static stages and strokes, in place of measuring: runs, imported "
                "folders, campaigns."
            ),
        ),
    ] = None,
    rig: Rig = "twin",
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="DIR",
            callback=out_folder,
            help="Folder for runs, reports, figures and paper.html.",
        ),
    ] = Path("paper"),
    static_protocol: Annotated[
        str,
        typer.Option(
            "--static-protocol", metavar="NAME|FILE", help="The protocol of the static stages."
        ),
    ] = "static-angle",
    protocol: Annotated[
        str,
        typer.Option("--protocol", metavar="NAME|FILE", help="The protocol of the strokes."),
    ] = "table2",
    after_trip: Annotated[
        bool,
        typer.Option(
            "--after-trip",
            help="Go on although a limit had stopped the motion; look at the rig first.",
        ),
    ] = False,
    seed: Seed = None,
    operator: Operator = "",
    sample: Sample = "",
    pdf: Pdf = False,
    as_json: Json = False,
) -> None:
    """Section IV of the paper as one command: static stages, torque-rotation curve, strokes, Table
    II with nothing fitted to them, cross-check, figures.

    The same command goes on where it was stopped. A twin's camera is calibrated first; on a real
    rig calibrate camera has done that before.

    Example: rfca-rig paper --out paper
    """
    import json

    from rfca_rig.cli.commands.measure import static
    from rfca_rig.cli.options import PageCopies
    from rfca_rig.reports.paper.page import HTML, describe_result, summarize, write_paper

    copies = PageCopies(pdf)
    measuring = None
    if paths:
        static_paths, stroke_paths = _split_paths(paths)
    else:
        measuring = Measuring(rig, static_protocol, protocol, after_trip, seed, operator, sample)
        static_paths = [_measure_stages(out, measuring)]
    curve = static.write(
        static_paths, out / STATIC_REPORT, static.StaticReportOptions(), quiet=as_json
    )
    model = _choose_model(curve, out / STATIC_REPORT)
    if measuring is not None:
        stroke_paths = [_measure_strokes(out, measuring, model)]
    recorded = Recorded(static_paths, stroke_paths, model)
    reproduction = _evaluate(curve, recorded, out, as_json)
    write_paper(reproduction, out, _describe_work(recorded, out, measuring))
    if as_json:
        echo(json.dumps(summarize(reproduction), indent=1))
    else:
        for line in describe_result(reproduction):
            echo(line, err=True)
        echo(f"{out / HTML}: Table I and II, Fig. 7", err=True)
        following = _following(str(out / DIAGNOSIS), [str(path) for path in stroke_paths])
        echo(f"next: {following}", err=True)
    copies.make([out / HTML], as_json)


@dataclass(frozen=True)
class Measuring:
    """The options of the two runs as typed."""

    rig: str
    static_protocol: str
    protocol: str
    after_trip: bool
    seed: int | None
    operator: str
    sample: str

    def typed(self) -> dict[str, object]:
        """Those that are not their defaults, for the command in the page's foot."""
        options: dict[str, object] = {
            "--rig": self.rig,
            "--static-protocol": self.static_protocol,
            "--protocol": self.protocol,
            "--seed": self.seed,
        }
        return {name: value for name, value in options.items() if value != USUAL.get(name)}


def _split_paths(paths: "Sequence[Path]") -> tuple[list[Path], list[Path]]:
    """The paths with static stages, and those with strokes. Raises BadInput where one kind is
    missing.
    """
    from rfca_rig.campaign.opening import open_recordings
    from rfca_rig.errors import BadInput

    with_stages = []
    with_strokes = []
    for path in paths:
        recordings = open_recordings([path])
        if any(_has_angles(recording) for recording in recordings):
            with_stages.append(path)
        if any(recording.strokes for recording in recordings):
            with_strokes.append(path)
    if not with_stages:
        raise BadInput(
            "paper: none of these recordings has static stages with hinge angles, from which the "
            "springs would come; add such a recording"
        )
    if not with_strokes:
        raise BadInput("paper: none of these recordings has strokes; add such a recording")
    return with_stages, with_strokes


def _has_angles(recording: "Recording") -> bool:
    import numpy as np

    return any(np.isfinite(stage.hinge_deg).any() for stage in recording.static)


def _measure_stages(out: Path, measuring: Measuring) -> Path:
    """The folder of the static run: recorded now, continued where it was stopped, or as it is."""
    from rfca_rig.cli.commands.measure import static
    from rfca_rig.cli.paths import find_file, find_rig
    from rfca_rig.description.protocol_file import read_dynamic, read_static
    from rfca_rig.description.rig_file import read_rig
    from rfca_rig.errors import BadInput

    rig_path = find_rig(measuring.rig)
    rig = read_rig(rig_path)
    # All files are read before anything is made or moves.
    read_static(find_file("protocols", measuring.static_protocol))
    read_dynamic(find_file("protocols", measuring.protocol))
    if rig.camera is None:
        raise BadInput(
            f"{rig_path}: has no [camera], and the springs come from photographed stages; add that "
            "section"
        )
    camera = None
    if not rig.is_real:
        camera = _calibrate_twin(rig, out, measuring.seed)
    if not _has_run(out / RUNS, "static", measuring):
        static.run(
            protocol=measuring.static_protocol,
            rig=measuring.rig,
            camera=camera,
            runs=out / RUNS,
            seed=measuring.seed,
            operator=measuring.operator,
            sample=measuring.sample,
        )
    return _find_run(out / RUNS, "static")


def _measure_strokes(out: Path, measuring: Measuring, model: Path) -> Path:
    """The folder of the strokes, in the same way; loads are expected of the model with the measured
    curve.
    """
    from rfca_rig.cli.commands.measure import dynamic

    if not _has_run(out / RUNS, "dynamic", measuring):
        dynamic.run(
            protocol=measuring.protocol,
            rig=measuring.rig,
            model=model,
            runs=out / RUNS,
            seed=measuring.seed,
            operator=measuring.operator,
            sample=measuring.sample,
        )
    return _find_run(out / RUNS, "dynamic")


def _calibrate_twin(rig: "RigFile", out: Path, seed: int | None) -> Path:
    """The camera file from photos of a board that the twin's camera takes."""
    from rfca_rig.bench.board_session import PLANE_CORNER_MM, PLANE_PHOTO, write_board_photos
    from rfca_rig.cli.commands.calibrate import (
        BOARD,
        PlanePhoto,
        describe_calibration,
        write_calibration,
    )
    from rfca_rig.cli.progress import make_marked_say, progress
    from rfca_rig.vision.board import parse_board
    from rfca_rig.vision.camera_calibration import BoardPlacement

    file = out / CAMERA
    say = make_marked_say("SIM", quiet=False)
    if file.is_file():
        say(f"{file}: calibrated already")
        return file
    board = parse_board(BOARD)
    folder = out / BOARD_PHOTOS
    with progress(quiet=False) as bars:
        photos = write_board_photos(rig, board, folder, seed, bars.counting("photos of the board"))
    corner_m = (1e-3 * PLANE_CORNER_MM[0], 1e-3 * PLANE_CORNER_MM[1])
    plane = PlanePhoto(folder / PLANE_PHOTO, BoardPlacement(corner_m, "right", 0.0, 0.0))
    camera = write_calibration(photos, board, plane, file, make_marked_say("SIM", quiet=True))
    for line in describe_calibration(camera, file):
        say(line)
    return file


def _has_run(runs: Path, experiment: str, measuring: Measuring) -> bool:
    """Whether the folder has a run of this experiment, continued here where it was stopped.

    Raises BadInput where it was recorded with another rig file.
    """
    from rfca_rig.cli.commands.measure.resume import resume
    from rfca_rig.cli.paths import find_rig
    from rfca_rig.errors import BadInput
    from rfca_rig.recording.run_text import read_ending, read_header
    from rfca_rig.toml import read_text

    folder = _look_for_run(runs, experiment)
    if folder is None:
        return False
    if read_header(folder).provenance.get("rig_file") != read_text(find_rig(measuring.rig)):
        raise BadInput(
            f"{folder}: was recorded with another rig file than {measuring.rig}; give another --out"
        )
    ending = read_ending(folder)
    if ending is None or ending.provenance.get("ended") != "done":
        resume(folder, after_trip=measuring.after_trip, operator=measuring.operator)
    else:
        echo(f"{folder}: recorded already", err=True)
    return True


def _look_for_run(runs: Path, experiment: str) -> Path | None:
    from rfca_rig.recording import run_folder
    from rfca_rig.recording.run_text import read_header

    for folder in sorted(runs.glob("*")):
        if not run_folder.is_run(folder):
            continue
        if read_header(folder).provenance.get("experiment") == experiment:
            return folder
    return None


def _find_run(runs: Path, experiment: str) -> Path:
    from rfca_rig.errors import BadInput

    folder = _look_for_run(runs, experiment)
    if folder is None:
        raise BadInput(f"{runs}: holds no {experiment} run; give another --out")
    return folder


def _choose_model(result: "StaticResult", report: Path) -> Path:
    """The model file with the measured springs. Raises BadInput where none could be written."""
    from rfca_rig.errors import BadInput
    from rfca_rig.reports.static.files import choose_model_name

    name = choose_model_name(result)
    if not name:
        raise BadInput(
            f"{report / 'static.html'}: the torque-rotation curve falls somewhere, and no model "
            "can follow it; look at the page, and measure the stages again"
        )
    return report / name


@dataclass(frozen=True)
class Recorded:
    """Where the recordings are, and the model file with the measured springs."""

    static_paths: "Sequence[Path]"
    stroke_paths: "Sequence[Path]"
    model: Path

    @property
    def paths(self) -> list[Path]:
        """All of them once."""
        return list(dict.fromkeys([*self.static_paths, *self.stroke_paths]))


def _evaluate(curve: "StaticResult", recorded: Recorded, out: Path, quiet: bool) -> "Reproduction":
    """Comparison and cross-check; the report on the strokes is written into `out`."""
    from dataclasses import replace

    from rfca_rig.analysis.mujoco_leg import load_mujoco
    from rfca_rig.analysis.reproduction import check_against_mujoco, reproduce_strokes
    from rfca_rig.campaign.opening import open_recordings
    from rfca_rig.cli.commands.report import write as write_report
    from rfca_rig.cli.progress import announce_first_compile, progress
    from rfca_rig.description.model_file import read_model_file
    from rfca_rig.errors import BadInput
    from rfca_rig.reports.problems import ComparisonOptions

    options = ComparisonOptions(model=recorded.model)
    write_report(recorded.stroke_paths, out / REPORT, options, as_json=False, quiet=True)
    model = read_model_file(recorded.model)
    recordings = open_recordings(recorded.stroke_paths)
    strokes = [stroke for recording in recordings for stroke in recording.strokes]
    with progress(quiet) as bars:
        announce_first_compile(bars, quiet)
        reproduction = reproduce_strokes(
            curve,
            model.model(),
            model.known_to.model_dump(exclude_none=True),
            strokes,
            bars.counting("conditions"),
        )
        try:
            load_mujoco()
            checked = check_against_mujoco(reproduction, bars.counting("MuJoCo"))
        except BadInput as error:
            # The cross-check is the only part that may be missing; the page states why.
            return replace(reproduction, not_checked=str(error))
    return replace(reproduction, checked=checked)


def _describe_work(recorded: Recorded, out: Path, measuring: Measuring | None) -> "PaperContext":
    """Origin, recordings and steps for the page; `measuring` is None where recordings were
    given.
    """
    from rfca_rig.campaign.opening import open_recordings
    from rfca_rig.reports.paper.page import PaperContext
    from rfca_rig.reports.provenance import command_line, origin_of

    recordings = open_recordings(recorded.paths)
    if measuring is None:
        command = command_line("paper", *recorded.paths, options={"--out": out})
    else:
        command = command_line("paper", options={**measuring.typed(), "--out": out})
    return PaperContext(
        origin_of(command, recorded.paths, recordings),
        tuple((recording.source, recording.title) for recording in recordings),
        tuple(_list_steps(recorded, out, measuring)),
        _following(out / DIAGNOSIS, recorded.stroke_paths),
    )


def _list_steps(
    recorded: Recorded, out: Path, measuring: Measuring | None
) -> "Iterator[PaperStep]":
    """The steps with the commands that do each of them alone."""
    from rfca_rig.bench.board_session import PLANE_CORNER_MM, PLANE_PHOTO
    from rfca_rig.reports.paper.page import PaperStep
    from rfca_rig.reports.provenance import command_line

    camera = out / CAMERA
    model = recorded.model
    rig = measuring.typed().get("--rig") if measuring else None
    if camera.is_file() and measuring:
        board = out / BOARD_PHOTOS
        across_mm, up_mm = PLANE_CORNER_MM
        options: dict[str, object] = {
            "--plane": board / PLANE_PHOTO,
            "--board-at": f"{across_mm:g},{up_mm:g}",
            "--out": camera,
        }
        calibrate = command_line("calibrate", "camera", board, options=options)
        yield PaperStep("Camera, from photos of a board", calibrate)
    if measuring:
        options = {
            "--protocol": measuring.static_protocol,
            "--rig": rig,
            "--camera": camera if camera.is_file() else None,
        }
        yield PaperStep(
            "Static stages, photographed", command_line("static", "run", options=options)
        )
    yield PaperStep(
        "Torque over rotation",
        command_line(
            "static", "report", *recorded.static_paths, options={"--out": out / STATIC_REPORT}
        ),
        f"{STATIC_REPORT}/static.html",
    )
    if measuring:
        options = {"--protocol": measuring.protocol, "--rig": rig, "--model": model}
        yield PaperStep("Strokes", command_line("dynamic", "run", options=options))
    options = {"--model": model, "--out": out / REPORT}
    yield PaperStep(
        "Every stroke over the model, its shaft at the average speed",
        command_line("report", *recorded.stroke_paths, options=options),
        f"{REPORT}/report.html",
    )
    yield PaperStep(
        "Contact force by MuJoCo", command_line("crosscheck", options={"--model": model})
    )


def _following(out: Path | str, stroke_paths: "Sequence[Path | str]") -> str:
    """The next step: what the model lacks, where it is wrong. Paths are shown as on a page, texts
    as they are.
    """
    from rfca_rig.reports.provenance import command_line

    return command_line("diagnose", *stroke_paths, options={"--out": out})
