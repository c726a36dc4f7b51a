"""rfca-rig setup: the first day with a real rig. A command to each file, with its name."""

import typer

from rfca_rig.cli.commands.setup import motor, sensor, zero
from rfca_rig.cli.options import Command

app = typer.Typer(
    name="setup",
    help="The first day with a real rig: drives, zeros and axes are set up and checked.",
    no_args_is_help=True,
)
app.command("motor", cls=Command)(motor.motor)
app.command("zero", cls=Command)(zero.zero)
app.command("sensor", cls=Command)(sensor.sensor)
