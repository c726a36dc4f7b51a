"""Options that several commands share, and the checks of their values before the work."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import refuse_devices

Rig = Annotated[str, typer.Option("--rig", metavar="NAME|FILE", help="The rig: a name in calibration/ (plan --list), or a .toml file.")]
Protocol = Annotated[
    str, typer.Option("--protocol", metavar="NAME|FILE", help="The protocol: a name in protocols/ (plan --list), or a .toml file.")
]
Seed = Annotated[int | None, typer.Option("--seed", metavar="N", min=0, help="Seed of the twin's noise; the rig file's own if not given.")]
Model = Annotated[
    Path | None,
    typer.Option("--model", metavar="FILE", help="A model file, as fit --out writes it, in place of the nominal model."),
]
Operator = Annotated[str, typer.Option("--operator", metavar="NAME", help="Who runs the rig; the login name if not given.")]
Sample = Annotated[str, typer.Option("--sample", metavar="NAME", help="Which specimen is on the rig, as it is labelled.")]
Fault = Annotated[
    list[str] | None,
    typer.Option(
        "--fault",
        metavar="NAME@SECONDS",
        help="Let a twin's device fail then, or NAME@FROM-TO; may be repeated. twin serve --list prints the names.",
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


def out_folder(folder: Path | None) -> Path | None:
    """The folder unchanged, if it exists and is writable, or can be made. Raises BadInput."""
    if folder is None:
        return None
    # A folder that does not exist yet is made below its nearest existing parent, which must be writable.
    nearest = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not nearest.is_dir():
        raise BadInput(f"{folder}: {'is' if nearest == folder else f'{nearest} is'} a file, where a folder is needed; name another")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise BadInput(f"{folder}: nothing may be written into {nearest}; name another folder, or make that one yours")
    return folder


def out_file(file: Path | None) -> Path | None:
    """The file unchanged, if it can be written. Raises BadInput."""
    if file is None:
        return None
    if file.is_dir():
        raise BadInput(f"{file}: is a folder, where a file is needed; name a file in it")
    refuse_devices(file)
    if not file.parent.is_dir():
        raise BadInput(f"{file}: there is no folder {file.parent}; make it, or name another file")
    if not os.access(file if file.exists() else file.parent, os.W_OK):
        raise BadInput(f"{file}: may not be written; name another file, or make that one yours")
    return file


Runs = Annotated[Path, typer.Option("--runs", metavar="DIR", callback=out_folder, help="Folder that receives the new run folder.")]


class Printing:
    """Raises BadInput at once where PDFs are wanted and no browser is found."""

    def __init__(self, wanted: bool) -> None:
        from rfca_rig.reports.pdf import find_browser

        self._browser = find_browser() if wanted else None

    def print(self, pages: Iterable[Path], quiet: bool) -> None:
        """Prints the pages; does nothing where no PDFs are wanted."""
        from rfca_rig.reports.pdf import print_pdfs

        if self._browser is None:
            return
        for printed in print_pdfs(self._browser, pages):
            if not quiet:
                typer.echo(f"{printed}: the same page, printed", err=True)
