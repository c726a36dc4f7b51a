"""rfca-rig init"""

from pathlib import Path
from typing import Annotated

import typer


def init(
    mjcf: Annotated[Path, typer.Option("--mjcf", "--urdf", metavar="FILE", help="The mechanism's model, MJCF or URDF.")],
    data: Annotated[Path, typer.Option("--data", metavar="DIR", help="A folder with its recordings: CSV, HDF5, MCAP or ROS 2 bags.")],
) -> None:
    """Write a draft of experiment.toml for recordings of any mechanism.

    Example: rfca-rig init --mjcf arm.xml --data recordings
    """
    from rfca_rig.campaign.experiment_draft import PLACEHOLDER, write_draft
    from rfca_rig.mechanism.load import load_mechanism

    path = write_draft(load_mechanism(mjcf), data)
    open_questions = path.read_text(encoding="utf-8").count(f"= {PLACEHOLDER}")
    typer.echo(f"{path}: {open_questions} values to fill in, each marked with a question mark")
    typer.echo(f"then: rfca-rig check {data}", err=True)
