"""rfca-rig schema, rfca-rig init: the form and the draft of files that people write; rfca-rig trip: the page of a code"""

import re
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import typer

FileKind = Literal["rig", "protocol", "experiment", "campaign", "sweep"]

WIDTH = 80


def schema(kind: Annotated[FileKind, typer.Argument(metavar="KIND", help=f"The file: {', '.join(get_args(FileKind))}.")]) -> None:
    """Print the JSON schema of a file that you write, with which an editor completes and checks its keys.

    Editors with Taplo read it after a first line #:schema rig.json in the TOML file.

    Example: rfca-rig schema rig > rig.json
    """
    import json

    from pydantic import TypeAdapter
    from pydantic.json_schema import GenerateJsonSchema

    from rfca_rig.campaign.experiment_layout import ExperimentFile
    from rfca_rig.campaign.layout import CampaignFile
    from rfca_rig.description.protocol_file import DynamicFile, FatigueFile, StaticFile
    from rfca_rig.description.rig_file import RigFile
    from rfca_rig.sweep.sweep_file import SweepFile

    models: dict[FileKind, Any] = {
        "rig": RigFile,
        "protocol": DynamicFile | StaticFile | FatigueFile,
        "experiment": ExperimentFile,
        "campaign": CampaignFile,
        "sweep": SweepFile,
    }
    head = {"$schema": GenerateJsonSchema.schema_dialect, "title": f"rfca-rig: {kind} file"}
    typer.echo(json.dumps(head | TypeAdapter(models[kind]).json_schema() | head, indent=1))


def init(
    mjcf: Annotated[Path, typer.Option("--mjcf", "--urdf", metavar="FILE", help="The mechanism's model, MJCF or URDF.")],
    data: Annotated[Path, typer.Option("--data", metavar="DIR", help="A folder with its recordings: CSV, HDF5, MCAP or ROS 2 bags.")],
) -> None:
    """Write a draft of experiment.toml for recordings of any mechanism.

    Example: rfca-rig init --mjcf arm.xml --data recordings
    """
    from rfca_rig.campaign.experiment import PLACEHOLDER, write_draft
    from rfca_rig.mechanism.load import load_mechanism

    path = write_draft(load_mechanism(mjcf), data)
    open_questions = path.read_text(encoding="utf-8").count(f"= {PLACEHOLDER}")
    typer.echo(f"{path}: {open_questions} values to fill in, each marked with a question mark")
    typer.echo(f"then: rfca-rig check {data}", err=True)


def trip(code: Annotated[str, typer.Argument(metavar="CODE", help="Such as F-02; without it, all codes are listed.")] = "") -> None:
    """Say what a code that stopped a run means: likely causes, how to tell them apart, what to change and what not, how to go on.

    Example: rfca-rig trip F-02
    """
    from rfca_rig.errors import BadInput, Trip

    known = [str(one) for one in Trip]
    if not code:
        typer.echo("\n".join(f"{one}  {_title(one)}" for one in known))
        return
    if code.upper() not in known:
        raise BadInput(f"{code}: no code of a trip; known are {', '.join(known)}")
    typer.echo("\n".join(_lines(_page(code.upper()))))


def _lines(page: str) -> list[str]:
    """The page as a terminal shows it: paragraphs and items within 80 columns, without marks and links."""
    from textwrap import wrap

    # Blocks begin at an empty line, a numbered item or a heading; each is wrapped on its own.
    blocks = re.split(r"\n(?=\n|\d\. |# )", re.sub(r" \[All trips\]\(.*?\)|```(text)?\n|\*\*", "", page))
    plain = (re.sub(r"\[(.*?)\]\(.*?\)", r"\1", block).replace("`", "") for block in blocks)
    return [
        line
        for block in plain
        for line in ([] if block.strip() and not block.startswith("\n") else [""])
        + wrap(" ".join(block.split()), WIDTH, subsequent_indent="   " if block[:1].isdigit() else "", break_on_hyphens=False)
    ]


def _title(code: str) -> str:
    """The text behind the code in the page's heading."""
    return _page(code).partition("\n")[0].partition(": ")[2]


def _page(code: str) -> str:
    from rfca_rig.cli.paths import folders_of
    from rfca_rig.errors import BadInput

    for folder in folders_of("docs"):
        page: Path = folder / "trips" / f"{code}.md"
        if page.is_file():
            return page.read_text(encoding="utf-8")
    raise BadInput(f"docs/trips/{code}.md did not come with this installation; it is in the package's repository")
