"""rfca-rig schema: the form of files that people write."""

from typing import Annotated, Any, Literal, get_args

import typer

FileKind = Literal["rig", "protocol", "experiment", "campaign", "sweep"]


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
