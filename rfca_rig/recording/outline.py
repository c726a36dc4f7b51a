"""Summary of a recording in one file, without its samples."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rfca_rig.recording.cycle_table import CYCLES, NUMBER
from rfca_rig.recording.model import StaticStage
from rfca_rig.recording.raw_stages import GROUP as RAW
from rfca_rig.recording.static_table import read_static
from rfca_rig.recording.store import open_sealed, read_provenance, read_title
from rfca_rig.recording.strokes import GROUP as STROKES
from rfca_rig.recording.strokes import read_condition


@dataclass(frozen=True)
class RunOutline:
    """`strokes` has (height in mm, speed in rad/s, repeat) of each stroke.

    `last_cycle` is the number of the last cycle in the file, 0 without cycles.
    """

    title: str
    source: str
    provenance: Mapping[str, str]
    strokes: tuple[tuple[float, float, int], ...]
    static: tuple[StaticStage, ...]
    cycles: int
    last_cycle: int


def outline_of(path: Path) -> RunOutline:
    """Reads the outline of a file. Raises BadInput for a file that is damaged or of another kind."""
    with open_sealed(path) as (file, source):
        tables = [stage[CYCLES][NUMBER] for stage in file.get(RAW, {}).values() if CYCLES in stage]
        return RunOutline(
            title=read_title(file),
            source=source,
            provenance=read_provenance(file),
            strokes=tuple(read_condition(file[STROKES][number]) for number in sorted(file[STROKES], key=int)),
            static=read_static(file),
            cycles=sum(len(table) for table in tables),
            last_cycle=max((int(table[-1]) for table in tables if len(table)), default=0),
        )
