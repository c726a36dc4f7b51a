"""rfca-rig export, rfca-rig import"""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from rfca_rig.cli.options import AllowOutside, Command, Json, Model, Rig, out_file
from rfca_rig.cli.terminal import echo

app = typer.Typer(
    help="Recordings for other programs: MCAP for Foxglove and PlotJuggler, CSV for the rest. And "
    "the model of the leg: FMU, MJCF.",
    no_args_is_help=True,
)
Recorded = Annotated[
    Path, typer.Argument(metavar="RUN", help="A run's folder, its run.h5, or a campaign.")
]


@app.command("mcap", cls=Command)
def export_mcap(
    run: Recorded,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The .mcap file to write.")],
    as_json: Json = False,
) -> None:
    """Write a recording as MCAP: samples, stages, events and photos by the host's clock.

    Foxglove, Lichtblick and PlotJuggler open it without plugins; see docs/live-view.md. Needs pip
    install "rfca-rig[mcap]".

    Example: rfca-rig export mcap runs/SIM-table-ii-001 --out table-ii.mcap
    """
    import json
    from importlib.util import find_spec

    from rfca_rig.errors import BadInput

    # Asked separately: finding google.protobuf raises where there is no package google.
    if (
        any(find_spec(name) is None for name in ("mcap", "google"))
        or find_spec("google.protobuf") is None
    ):
        raise BadInput('MCAP is an extra that is not installed; type pip install "rfca-rig[mcap]"')
    from rfca_rig.cli.progress import progress
    from rfca_rig.export.mcap_file import export_mcap as export

    with progress(as_json) as bars:
        exported = export(run, out, bars.counting("stages"))
    if as_json:
        counts = {
            "messages": exported.messages,
            "pictures": exported.pictures,
            "missing": list(exported.missing),
        }
        echo(json.dumps({"out": str(out), **counts}, indent=1))
        return
    # A lost photo must not prevent the export of everything else.
    for name in exported.missing:
        echo(f"{run / name}: is not there or is no picture, so it is left out", err=True)
    echo(
        (
            f"{exported.messages} messages, {exported.pictures} of them pictures, in {out}; "
            "open it in Foxglove or PlotJuggler"
        ),
        err=True,
    )


@app.command("csv", cls=Command)
def export_csv(
    run: Recorded,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="The folder to make.")],
    as_json: Json = False,
) -> None:
    """Write a recording as CSV: a file per stage and device, and one of all static stages. With
    campaign.toml beside them, import reads the folder back.

    Example: rfca-rig export csv runs/SIM-table-ii-001 --out table-ii
    """
    import json

    from rfca_rig.cli.progress import progress
    from rfca_rig.export.csv_files import export_csv as export

    with progress(as_json) as bars:
        exported = export(run, out, bars.counting("stages"))
    if as_json:
        echo(
            json.dumps(
                {
                    "out": str(out),
                    "files": exported.files,
                    "records": exported.records,
                    "is_campaign": exported.is_campaign,
                },
                indent=1,
            )
        )
        return
    back = f"; rfca-rig import {out} reads them back"
    if not exported.is_campaign:
        back = "; the recording has no nominal model, so import does not take them"
    echo(
        f"{exported.records} records in {exported.files} files; {out / 'stages.csv'} lists them"
        f"{back}",
        err=True,
    )


@app.command("can", cls=Command)
def export_can(
    run: Recorded,
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="FILE", help="The file to write: .asc, .blf, .log (candump) or .trc."
        ),
    ],
    as_json: Json = False,
) -> None:
    """Write the CAN frames of a recording as a log for tools of a bus; record records them.

    Example: rfca-rig export can runs/REAL-listening-001 --out bus.blf
    """
    import json

    from rfca_rig.cli.progress import progress
    from rfca_rig.export.can_log import export_can_log

    with progress(as_json) as bars:
        frames = export_can_log(run, out, bars.counting("stages"))
    if as_json:
        echo(json.dumps({"out": str(out), "frames": frames}, indent=1))
        return
    echo(f"{frames} frames in {out}", err=True)


@app.command("mjcf", cls=Command)
def export_mjcf(
    run: Recorded,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="The folder to make.")],
    allow_outside: AllowOutside = False,
    as_json: Json = False,
) -> None:
    """Write a leg and its strokes as an experiment on a mechanism: MJCF for MuJoCo,
    experiment.toml, and a CSV file per stroke.

    check, fit, report and diagnose take the folder; see docs/mechanisms.md.

    Example: rfca-rig export mjcf campaigns/my-leg --out my-leg-mjcf
    """
    import json

    from rfca_rig.export.leg_mjcf import export_leg

    exported = export_leg(run, out, allow_outside)
    if as_json:
        echo(
            json.dumps(
                {
                    "out": str(out),
                    "recordings": exported.recordings,
                    "left_out": list(exported.left_out),
                },
                indent=1,
            )
        )
        return
    for words in exported.left_out:
        echo(f"left out: {words}", err=True)
    echo(f"{exported.recordings} strokes in {out}; type rfca-rig diagnose {out}", err=True)


class ShaftInput(StrEnum):
    """Input of an exported leg."""

    SPEED = "speed"
    TORQUE = "torque"


class Platform(StrEnum):
    """What the binary of an exported leg runs on."""

    LINUX = "x86_64-linux"
    WINDOWS = "x86_64-windows"


@app.command("fmu", cls=Command)
def export_fmu(
    out: Annotated[
        Path,
        typer.Option("--out", metavar="FILE", callback=out_file, help="The .fmu file to write."),
    ],
    rig: Rig = "twin",
    model: Model = None,
    height: Annotated[
        float,
        typer.Option(
            "--height",
            metavar="MM",
            min=1,
            max=1000,
            help="Height of the shaft above the ground at the start; a parameter of the FMU.",
        ),
    ] = 215.0,
    shaft_input: Annotated[
        ShaftInput,
        typer.Option(
            "--input",
            metavar="HOW",
            help="What turns the shaft: speed (a commanded speed), torque (of a drive).",
        ),
    ] = ShaftInput.SPEED,
    platform: Annotated[
        list[Platform] | None,
        typer.Option(
            "--platform",
            metavar="NAME",
            help=(
                "What the FMU runs on: x86_64-linux, x86_64-windows; this computer's if not "
                "given. Repeat it for both."
            ),
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write the model of a leg, with its effects, as an FMU for co-simulation (FMI 3.0): for
    Simulink, Dymola, OpenModelica, RecurDyn, FMPy.

    It needs no Python where it runs. It is compiled here for half a minute, by the system's C
    compiler or that of pip install "rfca-rig[fmu]"; see docs/fmu.md.

    Example: rfca-rig export fmu --rig twin --out leg.fmu
    """
    import json

    from rfca_rig.cli.paths import find_rig
    from rfca_rig.cli.progress import progress
    from rfca_rig.description.model_file import read_model_file
    from rfca_rig.description.rig_file import read_rig
    from rfca_rig.export.fmu import LegModel, list_left_out
    from rfca_rig.export.fmu import export_fmu as export

    if model is not None:
        leg = LegModel(read_model_file(model).model(), model.stem, "model file", model)
    else:
        path = find_rig(rig)
        file = read_rig(path)
        leg = LegModel(file.model(), file.rig.title, "rig file", path, list_left_out(file))
    with progress(as_json) as bars:
        bars.show_unbounded("compiling", lambda: "half a minute")
        exported = export(
            leg,
            out,
            height / 1e3,
            shaft_input.value,
            [item.value for item in platform or ()],
        )
    if as_json:
        names = {
            "platforms": list(exported.platforms),
            "inputs": list(exported.inputs),
            "outputs": list(exported.outputs),
            "parameters": list(exported.parameters),
            "left_out": list(leg.left_out),
        }
        echo(json.dumps({"out": str(out), **names}, indent=1))
        return
    for words in leg.left_out:
        echo(f"left out: {words}", err=True)
    echo(
        f"{out}: {', '.join(exported.inputs)} in, {len(exported.outputs)} outputs, "
        f"{len(exported.parameters)} parameters, for {' and '.join(exported.platforms)}",
        err=True,
    )


def import_folder(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER",
            help="A folder with campaign.toml, or pendulum.toml, and its CSV files.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="New folder for the recording; runs/IMPORT-NAME if not given.",
        ),
    ] = None,
    as_is: Annotated[
        bool, typer.Option("--as-is", help="Import values that are probably in another unit, too.")
    ] = False,
    allow_outside: AllowOutside = False,
    as_json: Json = False,
) -> None:
    """Read recordings from elsewhere (format rfca-campaign/1) into the form that report and
    diagnosis work on.

    Recordings of a pendulum (format rfca-pendulum/1) are checked and copied as they stand. A folder
    with experiment.toml needs no import.

    Example: rfca-rig import my-campaign
    """
    import json

    from rfca_rig.campaign.opening import import_campaign, import_pendulum
    from rfca_rig.cli.progress import progress
    from rfca_rig.errors import BadInput
    from rfca_rig.recording.layout import EXPERIMENT, PENDULUM
    from rfca_rig.recording.store import read_recording

    if (folder / EXPERIMENT).is_file():
        raise BadInput(
            f"{folder}: holds experiment.toml, which every command reads as it stands; go "
            f"on with rfca-rig check {folder}"
        )
    target = out or Path("runs") / f"IMPORT-{folder.resolve().name}"
    if (folder / PENDULUM).is_file():
        pendulum = import_pendulum(folder, target, allow_outside)
        if as_json:
            links = sum(signal.quantity == "position" for signal in pendulum.signals)
            counts = {"links": links, "pendulum_runs": len(pendulum.runs)}
            echo(
                json.dumps(
                    {"source": "IMPORT", "run": str(target), "title": pendulum.title, **counts},
                    indent=1,
                )
            )
            return
        echo(
            (
                f"IMPORT {len(pendulum.runs)} runs of a pendulum in {target}; next: rfca-rig "
                f"diagnose {target}"
            ),
            err=True,
        )
        return
    with progress(as_json) as bars:
        recording = read_recording(
            import_campaign(folder, target, bars.counting("reading strokes"), as_is, allow_outside)
        )
    if as_json:
        counted = {"strokes": len(recording.strokes), "static_stages": len(recording.static)}
        echo(
            json.dumps(
                {"source": "IMPORT", "run": str(target), "title": recording.title, **counted},
                indent=1,
            )
        )
        return
    counted_text = f"{len(recording.strokes)} strokes and {len(recording.static)} static stages"
    if recorded_as := recording.provenance.get("recorded_as"):
        counted_text += f", recorded as {recorded_as},"
    echo(
        f"IMPORT {counted_text} in {target}; next: rfca-rig report {target} --out report", err=True
    )
