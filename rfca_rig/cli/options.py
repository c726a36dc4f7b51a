"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

Rig = Annotated[str, typer.Option("--rig", metavar="NAME|FILE", help="The rig: a name in calibration/, or a .toml file.")]
Runs = Annotated[Path, typer.Option("--runs", metavar="DIR", help="Folder that receives the new run folder.")]
Seed = Annotated[int | None, typer.Option("--seed", min=0, help="Seed of the twin's noise; the rig file's own if not given.")]
Model = Annotated[
    Path | None,
    typer.Option("--model", metavar="FILE", help="A model file, as fit --out writes it, in place of the model that was believed."),
]
Operator = Annotated[str, typer.Option("--operator", metavar="NAME", help="Who runs the rig; the login name if not given.")]
Sample = Annotated[str, typer.Option("--sample", metavar="NAME", help="Which specimen is on the rig, as it is labelled.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on standard output.")]
Dry = Annotated[bool, typer.Option("--dry-run", help="Print and check the plan, move nothing.")]
