"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

from rfca_rig.cli.writable import out_folder

Rig = Annotated[str, typer.Option("--rig", metavar="NAME|FILE", help="The rig: a name in calibration/, or a .toml file.")]
Runs = Annotated[Path, typer.Option("--runs", metavar="DIR", callback=out_folder, help="Folder that receives the new run folder.")]
Seed = Annotated[int | None, typer.Option("--seed", min=0, help="Seed of the twin's noise; the rig file's own if not given.")]
Model = Annotated[
    Path | None,
    typer.Option("--model", metavar="FILE", help="A model file, as fit --out writes it, in place of the nominal model."),
]
Operator = Annotated[str, typer.Option("--operator", metavar="NAME", help="Who runs the rig; the login name if not given.")]
Sample = Annotated[str, typer.Option("--sample", metavar="NAME", help="Which specimen is on the rig, as it is labelled.")]
Fault = Annotated[
    list[str] | None,
    typer.Option(
        "--fault", metavar="NAME@SECONDS", help="Let a twin's device fail then, or NAME@FROM-TO, to see what the run does; may be repeated."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on standard output.")]
AsIs = Annotated[bool, typer.Option("--as-is", help="Take values of a campaign that are probably in another unit, too.")]
Pdf = Annotated[bool, typer.Option("--pdf", help="Print the pages as PDF too, with the Chromium, Chrome or Edge of this machine.")]
Dry = Annotated[bool, typer.Option("--dry-run", help="Print and check the plan, move nothing.")]
View = Annotated[bool, typer.Option("--view", help="Watch the run in the browser, and stop it from there; the address is printed.")]
ViewPort = Annotated[
    int | None, typer.Option("--view-port", metavar="PORT", min=0, max=65535, help="The port of --view; any free one if not given.")
]
Pace = Annotated[
    float, typer.Option("--pace", metavar="X", min=0.0, help="With --view, a twin runs at X times real time at most; 0 is full speed.")
]
