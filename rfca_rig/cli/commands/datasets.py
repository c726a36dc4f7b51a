"""rfca-rig datasets list and get: recordings that other people published."""

import json
from pathlib import Path
from typing import Annotated

import typer

from rfca_rig.cli.options import Command, Json
from rfca_rig.cli.terminal import echo

app = typer.Typer(
    help="Recordings that other people published, to try the diagnosis on.", no_args_is_help=True
)


@app.command("list", cls=Command)
def list_sets(as_json: Json = False) -> None:
    """List the sets: name, licence, repository, and what the model of each omits on purpose.

    Example: rfca-rig datasets list
    """
    from rfca_rig.public_data.registry import read_registry

    sets = read_registry().sets
    if as_json:
        rows = [
            {
                "name": name,
                "split": public_set.split,
                "repository": public_set.group.source.repository,
                "commit": public_set.group.source.commit,
                "licence": public_set.group.source.licence,
                "copyright": public_set.group.source.copyright,
                "publication": public_set.group.source.publication,
                "changed": public_set.group.changed,
                "concealed": public_set.concealed,
                "published": public_set.published,
                "right": public_set.right,
            }
            for name, public_set in sets.items()
        ]
        echo(json.dumps(rows, indent=1))
        return
    for name, public_set in sets.items():
        source = public_set.group.source
        echo(f"{name}: omits {public_set.concealed}")
        echo(f"  github.com/{source.repository}, {source.licence}, (c) {source.copyright}")
    echo("next: rfca-rig datasets get NAME", err=True)


@app.command(cls=Command)
def get(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="The name of a set; datasets list prints them.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="The folder to be made; NAME in the current folder if not given.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Fetch a set from GitHub, compare it with its SHA-256, and convert it into a folder that
    check, fit, report and diagnose take.

    Source files are fetched once and kept in the user's cache. Without a network, put them below
    the folder that RFCA_RIG_DATASETS_SOURCES names, as OWNER/REPOSITORY/COMMIT/PATH.

    Example: rfca-rig datasets get simple
    """
    from rfca_rig.public_data.library import get as get_set

    def report_progress(line: str) -> None:
        if not as_json:
            echo(f"FETCH   {line}", err=True)

    folder = get_set(name, Path(name) if out is None else out, report_progress)
    if as_json:
        echo(json.dumps({"name": name, "folder": str(folder)}, indent=1))
        return
    echo(f"{folder}: recordings, model and description; README.txt has their origin")
    echo(f"next: rfca-rig diagnose {folder} --out diagnosis", err=True)
