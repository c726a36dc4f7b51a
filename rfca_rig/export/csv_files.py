"""A recording as CSV files for spreadsheets and scripts, every number as it was recorded, nothing resampled.

stages.csv              a row per file: which stage, which device, height, speed, repeat
stages/001-force.csv    a row per record; each device keeps its own times
static.csv              the means of static stages, as campaign files have them
"""

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rfca_rig.campaign.stored import Stored, stored_at
from rfca_rig.campaign.stored_streams import StoredStream
from rfca_rig.errors import BadInput
from rfca_rig.export.static_row import static_row
from rfca_rig.progress import Watcher, counted
from rfca_rig.recording.atomic import make_folder_atomically, refusals

TIME = "t_s"
INDEX = ("file", "stage", "device", "records", "height_mm", "speed_rad_s", "repeat", "cut_short")


@dataclass(frozen=True)
class ExportedCsv:
    """What went into the folder."""

    files: int
    records: int


def export_csv(run: Path, out: Path, told: Watcher) -> ExportedCsv:
    """Writes the folder `out`, whole or not at all, in little memory. Raises BadInput where it is there already or `run` is no recording,
    RigError when the disk refuses.
    """
    if out.exists():
        raise BadInput(f"{out}: is there already; name a folder that does not exist yet, or take this one away")
    written: list[dict[str, Any]] = []
    stored = stored_at(run)
    with refusals(out, "cannot be written"):
        make_folder_atomically(out, lambda folder: written.extend(_written(stored, folder, told)))
    return ExportedCsv(len(written), sum(row["records"] for row in written))


def _written(stored: Stored, folder: Path, told: Watcher) -> list[dict[str, Any]]:
    (folder / "stages").mkdir()
    rows = list(_stages(stored, folder, told))
    _write(folder / "stages.csv", INDEX, ([row.get(name, "") for name in INDEX] for row in rows))
    if stored.static:
        table = [static_row(held) for held in stored.static]
        _write(folder / "static.csv", list(table[0]), (list(row.values()) for row in table))
    return rows


def _stages(stored: Stored, folder: Path, told: Watcher) -> Iterator[dict[str, Any]]:
    for number, stage in enumerate(counted((*stored.strokes, *stored.raw), told), start=1):
        with stage.samples.opened() as streams:
            for stream in streams:
                name = f"stages/{number:03d}-{stream.name}.csv"
                _write(folder / name, [TIME, *stream.columns], _records(stream))
                yield {"file": name, "stage": stage.label, "device": stream.name, "records": len(stream.t_s), **stage.about}


def _records(stream: StoredStream) -> Iterator[Sequence[Any]]:
    for rows in stream.blocks():
        columns = [column.values(rows).tolist() for column in stream.columns.values()]
        yield from zip(stream.t_s[rows].tolist(), *columns, strict=True)


def _write(path: Path, heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(heads)
        writer.writerows(rows)
