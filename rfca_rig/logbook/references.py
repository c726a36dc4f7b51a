"""Which runs are the reference of a rig: `references.toml` beside the folders of the runs.

A rig has one reference for each specimen on it. Recordings of a mechanism are told apart by their
model file.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import Field

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.layout import CAMPAIGN, EXPERIMENT, HEADER, PENDULUM, RECORDING
from rfca_rig.toml import Section, read_data, read_text, read_toml, table

REFERENCES = "references.toml"
FORMAT = "rfca-references/1"


@dataclass(frozen=True)
class RigIdentity:
    """A rig by the name of its file, and the specimen on it as it is labelled; "" where a recording
    does not say.
    """

    rig: str = ""
    sample: str = ""

    def words(self) -> str:
        """For a message."""
        parts = [
            f"rig {self.rig}" if self.rig else "",
            f"sample {self.sample}" if self.sample else "",
        ]
        return ", ".join(filter(None, parts)) or "recordings that name no rig"


class ReferenceSection(Section):
    """The reference of one rig: names of folders beside this file."""

    rig: str = ""
    sample: str = ""
    runs: tuple[str, ...] = Field(strict=False, min_length=1)

    @property
    def identity(self) -> RigIdentity:
        """The rig that it belongs to."""
        return RigIdentity(self.rig, self.sample)


class ReferencesFile(Section):
    """The references of all rigs whose runs lie in a folder."""

    format: Literal["rfca-references/1"]
    references: tuple[ReferenceSection, ...] = Field((), strict=False)


def identify_rig(run: Path) -> RigIdentity:
    """The rig of a recorded folder. Raises BadInput where the folder has no recording, or its
    description cannot be read.
    """
    if (run / HEADER).is_file():
        text = read_text(run / HEADER)
        try:
            known = json.loads(text)["provenance"]
            # A rig is typed as a name or as the path of its file.
            return RigIdentity(Path(str(known.get("rig", ""))).stem, str(known.get("sample", "")))
        except (ValueError, LookupError, TypeError, AttributeError) as error:
            raise BadInput(
                f"{run / HEADER}: is no header of a run; rfca-rig check {run} tells more"
            ) from error
    if (run / EXPERIMENT).is_file():
        return RigIdentity(str(read_data(run / EXPERIMENT).get("model", "")))
    if any((run / name).is_file() for name in (PENDULUM, CAMPAIGN, RECORDING)):
        return RigIdentity()
    raise BadInput(f"{run}: holds no recording; name the folder of a run")


def read_references(runs: Path) -> tuple[ReferenceSection, ...]:
    """All references in a folder of runs. Raises BadInput where the file cannot be read."""
    path = runs / REFERENCES
    if not path.is_file():
        return ()
    return read_toml(path, ReferencesFile).references


def find_reference(run: Path) -> tuple[Path, ...]:
    """The folders of the reference of this run's rig; none where it has none, or where the run is
    part of it. Raises BadInput where a file cannot be read.
    """
    folder = run.resolve().parent
    references = read_references(folder)
    if not references:
        return ()
    identity = identify_rig(run)
    for reference in references:
        if reference.identity == identity and run.resolve().name not in reference.runs:
            return tuple(folder / name for name in reference.runs)
    return ()


def make_reference(runs: Sequence[Path]) -> ReferenceSection:
    """These runs as the reference of their rig. Raises BadInput where they lie in several folders
    or are of several rigs.
    """
    folder = runs[0].resolve().parent
    identity = identify_rig(runs[0])
    for run in runs[1:]:
        if run.resolve().parent != folder:
            raise BadInput(f"{run}: lies in another folder than {runs[0]}; a reference has one")
        other = identify_rig(run)
        if other != identity:
            raise BadInput(
                f"{run}: is of {other.words()}, {runs[0]} of {identity.words()}; a reference is of "
                "one rig and one sample"
            )
    names = tuple(dict.fromkeys(run.resolve().name for run in runs))
    return ReferenceSection(rig=identity.rig, sample=identity.sample, runs=names)


def set_reference(runs: Sequence[Path]) -> ReferenceSection:
    """Write that these runs are the reference of their rig, in place of the one before.

    Raises BadInput as `make_reference`, RigError where the disk refuses.
    """
    section = make_reference(runs)
    folder = runs[0].resolve().parent
    others = [other for other in read_references(folder) if other.identity != section.identity]
    _write(folder, [*others, section])
    return section


def clear_reference(run: Path) -> ReferenceSection | None:
    """Remove the reference of this run's rig, and return it; None where it has none."""
    folder = run.resolve().parent
    identity = identify_rig(run)
    references = read_references(folder)
    _write(folder, [other for other in references if other.identity != identity])
    return next((mine for mine in references if mine.identity == identity), None)


def _write(folder: Path, references: Sequence[ReferenceSection]) -> None:
    tables = [table("[references]", reference.model_dump()) for reference in references]
    text = f'format = "{FORMAT}"\n\n' + "\n".join(tables)
    write_atomically(folder / REFERENCES, text.encode("utf-8"))
