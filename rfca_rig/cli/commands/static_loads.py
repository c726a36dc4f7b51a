"""rfca-rig static load, rfca-rig static force"""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.lines import print_lines
from rfca_rig.cli.options import Json, Model, Rig
from rfca_rig.cli.writable import out_file

if TYPE_CHECKING:
    from rfca_rig.analysis.tip_load import FoundTipForce
    from rfca_rig.model.parameters import Leg

Angles = Annotated[
    str | None, typer.Option("--angles", metavar="DEG,DEG,...", help="The shaft from the horizontal, then each hinge, instead of a run.")
]


def load(
    down: Annotated[float, typer.Option("--down", metavar="N", min=-1e4, max=1e4, help="Force on the tip, downwards.")] = 0.0,
    along: Annotated[float, typer.Option("--along", metavar="N", min=-1e4, max=1e4, help="Force on the tip, away from the shaft.")] = 0.0,
    shaft: Annotated[float, typer.Option("--shaft", metavar="DEG", min=-360, max=360, help="Shaft below the horizontal.")] = 0.0,
    rig: Rig = "twin",
    model: Model = None,
    picture: Annotated[
        Path | None, typer.Option("--picture", metavar="FILE", callback=out_file, help="Draw the shape: .svg, .png or .pdf.")
    ] = None,
    as_json: Json = False,
) -> None:
    """The leg's shape and the torques of its hinges under a force at the tip, the shaft held; no floor, the weight counts.

    Example: rfca-rig static load --shaft 30 --down -20 --picture load.svg
    """
    import json

    import numpy as np

    from rfca_rig.analysis.tip_load import load_tip
    from rfca_rig.reports.style import check_picture_path

    if picture is not None:
        check_picture_path(picture)
    shape = load_tip(_leg(rig, model), float(np.radians(shaft)), np.array([along, down]))
    if picture is not None:
        from rfca_rig.reports.static.pictures import write_tip_load_picture

        write_tip_load_picture(shape, picture)
    if as_json:
        typer.echo(json.dumps(shape.summary(), indent=1))
    else:
        print_lines(shape.lines())


def force(
    run: Annotated[Path | None, typer.Argument(metavar="RUN", help="A run or campaign folder with photographed static stages.")] = None,
    angles: Angles = None,
    angle_std: Annotated[
        float, typer.Option("--angle-std", metavar="DEG", min=1e-4, max=10, help="One standard deviation of an angle that says none.")
    ] = 0.1,
    rig: Rig = "twin",
    model: Model = None,
    as_json: Json = False,
) -> None:
    """The force at the tip from the leg's shape, as a photo gives it; beside what the sensor felt, where a run has both.

    Only the tip may touch anything. A run's own leg counts, or that of --model; for --angles that of --rig.

    Example: rfca-rig static force --angles 30,-4.1,-4.9,-5.1,-4.6,-3.4,-1.8
    """
    import json

    import numpy as np

    from rfca_rig.analysis.tip_load import find_tip_force
    from rfca_rig.errors import BadInput

    if (run is None) == (angles is None):
        raise BadInput("static force takes either a run or --angles; give one of them")
    found: list[tuple[str, FoundTipForce, tuple[float, float] | None]] = []
    if angles is not None:
        shape = [np.radians(angle) for angle in _numbers(angles)]
        found.append(("these angles", find_tip_force(_leg(rig, model), shape, float(np.radians(angle_std))), None))
    else:
        from rfca_rig.campaign.opening import open_recordings
        from rfca_rig.cli.commands.static_report import read_nominal_values
        from rfca_rig.description.nominal_model import nominal_model
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
            std = float(np.radians(np.sqrt(np.mean(np.square(stds))) if stds else angle_std))
            label = f"stage {stage.stage}, {1e3 * stage.height_m:.0f} mm, shaft {np.degrees(stage.shaft_angle_rad):.1f} deg"
            shape = [stage.shaft_angle_rad, *np.radians(stage.hinge_deg)]
            # From the sensor's force to that at the tip: reversed along the ground, and without the leg's weight,
            # which the sensor carries too.
            found.append((label, find_tip_force(leg, shape, std), (-stage.fy_N, stage.fz_N - weight_N)))
        if not found:
            raise BadInput(f"{run}: has no static stage with all hinge angles; give --angles, or record with a camera")
    if as_json:
        typer.echo(json.dumps([_summary(*one) for one in found], indent=1))
    else:
        print_lines(_line(*one) for one in found)


def _leg(rig: str, model: Path | None) -> "Leg":
    from rfca_rig.cli.trusted_code import find_rig
    from rfca_rig.description.model_file import read_model_file
    from rfca_rig.description.rig_file import read_rig

    return (read_model_file(model) if model is not None else read_rig(find_rig(rig))).model().leg


def _numbers(text: str) -> list[float]:
    from rfca_rig.errors import BadInput

    try:
        angles = [float(part) for part in text.split(",")]
    except ValueError:
        angles = [float("nan")]
    if not all(math.isfinite(angle) for angle in angles):
        raise BadInput(f"--angles {text!r}: takes numbers in degrees with commas between them, as 30,-4,-5,-5,-5,-3,-2")
    return angles


def _line(label: str, found: "FoundTipForce", felt_N: "tuple[float, float] | None") -> str:
    from rfca_rig.reports.diagnosis.tables import STDS_90

    each = zip(found.force_N, found.std_N, ("along", "down"), strict=True)
    parts = [f"{force:+.2f} +- {STDS_90 * std:.2f} N {way}" for force, std, way in each]
    felt = "" if felt_N is None else f"; the sensor felt {felt_N[0]:+.2f} and {felt_N[1]:+.2f} N"
    return f"{label}: {', '.join(parts)} (90 %){felt}; hinge moments are left open by {found.residual_Nm:.2g} N m at most"


def _summary(label: str, found: "FoundTipForce", felt_N: "tuple[float, float] | None") -> dict[str, object]:
    return {
        "of": label,
        "force_N": found.force_N.tolist(),
        "std_N": found.std_N.tolist(),
        "residual_Nm": found.residual_Nm,
        "felt_N": None if felt_N is None else list(felt_N),
    }
