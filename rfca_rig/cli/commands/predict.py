"""rfca-rig predict, rfca-rig strip: one stroke of the model, without any rig"""

from pathlib import Path
from typing import Annotated

import typer

from rfca_rig.cli.options import Json, Model, Rig, out_file
from rfca_rig.cli.terminal import echo, print_lines


def predict(
    height: Annotated[
        float,
        typer.Option(
            "--height", metavar="MM", min=1, max=1000, help="Height of the shaft above the ground."
        ),
    ],
    speed: Annotated[
        float,
        typer.Option("--speed", metavar="RAD/S", min=0.01, max=100, help="Speed of the shaft."),
    ],
    rig: Rig = "twin",
    model: Model = None,
    sweep: Annotated[
        float,
        typer.Option("--sweep", metavar="DEG", min=1, max=330, help="How far the shaft turns."),
    ] = 200.0,
    csv: Annotated[
        Path | None,
        typer.Option(
            "--csv",
            metavar="FILE",
            callback=out_file,
            help="Write the stroke, sample by sample, to this CSV file.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """What the model expects of one stroke, without any rig: valley, peak force, torque.

    Example: rfca-rig predict --height 215 --speed 2.433
    """
    import json

    from rfca_rig.analysis.prediction import predict_stroke, write_csv
    from rfca_rig.cli.paths import find_rig
    from rfca_rig.cli.progress import announce_first_compile, progress
    from rfca_rig.description.model_file import read_model_file
    from rfca_rig.description.rig_file import read_rig

    if model:
        rig_model = read_model_file(model).model()
    else:
        rig_model = read_rig(find_rig(rig)).model()
    with progress(as_json) as bars:
        announce_first_compile(bars, as_json)
        prediction = predict_stroke(rig_model, height / 1e3, speed, sweep)
    if csv is not None:
        write_csv(prediction.stroke, csv)
    if as_json:
        echo(json.dumps(prediction.summary(), indent=1))
        return
    print_lines(prediction.lines())


def strip(
    height: Annotated[
        float,
        typer.Option(
            "--height", metavar="MM", min=1, max=1000, help="Height of the shaft above the ground."
        ),
    ] = 215.0,
    speed: Annotated[
        float,
        typer.Option("--speed", metavar="RAD/S", min=0.01, max=100, help="Speed of the shaft."),
    ] = 2.433,
    rig: Rig = "twin",
    as_json: Json = False,
) -> None:
    """Spring pieces of other materials and thicknesses: stiffness per hinge, valley of a stroke,
    strength used.

    Example: rfca-rig strip --height 235 --speed 3.276
    """
    import json

    from rfca_rig.analysis.strips import compare_strips
    from rfca_rig.cli.paths import find_rig
    from rfca_rig.cli.progress import announce_first_compile, progress
    from rfca_rig.description.rig_file import read_rig

    model = read_rig(find_rig(rig)).model()
    with progress(as_json) as bars:
        announce_first_compile(bars, as_json)
        comparison = compare_strips(model, height / 1e3, speed, bars.counting("strips"))
    if as_json:
        echo(json.dumps(comparison.summary(), indent=1))
        return
    print_lines(comparison.lines(), indent=" " * 13)
