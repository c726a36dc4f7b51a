"""Export of a recording as CSV files for spreadsheets and scripts. Numbers keep all recorded
digits; nothing is resampled.

stages.csv              a row per file: which stage, which device, height, speed, repeat
stages/001-force.csv    a row per record; each device keeps its own times
static.csv              the means of static stages, as campaign files have them
photos, overlays        the photos of static stages, with the marks that were found
campaign.toml           the nominal model and what each file holds, with which `import` reads the
                        folder back; of a run without a nominal model there is none
"""

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rfca_rig.campaign.layout import CAMPAIGN_FORMAT
from rfca_rig.campaign.opening import copy_pictures, list_pictures
from rfca_rig.campaign.stored import StoredRecording, StoredStream, open_stored
from rfca_rig.errors import BadInput
from rfca_rig.progress import ProgressCount, iterate_with_progress
from rfca_rig.recording.atomic import make_folder_atomically, translate_os_errors
from rfca_rig.recording.layout import CAMPAIGN
from rfca_rig.recording.model import StaticStage
from rfca_rig.recording.outside import refuse_outside
from rfca_rig.recording.strokes import height_mm
from rfca_rig.toml import format_value, table

TIME = "t_s"
LONGEST_NAME = 60
# Letters of a text in [about].
MOST_ABOUT = 200
INDEX = ("file", "stage", "device", "records", "height_mm", "speed_rad_s", "repeat", "cut_short")


def static_row(held: StaticStage) -> dict[str, Any]:
    """Means of a static stage under the column names of campaign files."""
    # Hinge 1 is the shaft: photos give hinges 2 to 7.
    hinges = {f"hinge{i}_deg": angle for i, angle in enumerate(held.hinge_deg, start=2)}
    about = {
        "height_mm": height_mm(held.height_m),
        "stage": held.stage,
        "direction": held.direction,
    }
    return {
        **about,
        "shaft_angle_rad": held.shaft_angle_rad,
        **hinges,
        **{name: getattr(held, name) for name in ("fy_N", "fz_N", "tx_Nm")},
    }


def _what_runs_have(held: StaticStage, std_names: Sequence[str]) -> dict[str, Any]:
    """What a run knows of a stage beside the means: how sure they are, and how they came about."""
    hinges = range(2, 2 + len(held.hinge_deg))
    stds = zip(hinges, held.hinge_std_deg, strict=True)
    reading_stds = zip(hinges, held.hinge_reading_std_deg, strict=True)
    settled = {None: "", False: "no", True: "yes"}[held.settled]
    return {
        **{f"hinge{i}_std_deg": std for i, std in stds},
        **{f"hinge{i}_reading_std_deg": std for i, std in reading_stds},
        **{f"std_{name}": held.std.get(name, "") for name in std_names},
        "settled": settled,
        "held_s": "" if held.held_s is None else held.held_s,
        "strokes_before": "" if held.strokes_before is None else held.strokes_before,
        "photo": held.photo,
        "overlay": held.overlay,
        "photo_doubts": held.photo_doubts,
    }


@dataclass(frozen=True)
class ExportedCsv:
    """Summary of an export: number of CSV files, and of records in them, and whether `import` takes
    the folder.
    """

    files: int
    records: int
    is_campaign: bool


def export_csv(run: Path, out: Path, report_progress: ProgressCount) -> ExportedCsv:
    """Writes the folder `out`, completely or not at all. Samples are read block by block, so memory
    does not grow with the recording.

    Parameters
    ----------
    run
        A run's folder, a recording file or a campaign.
    out
        The folder to make; it must not exist.
    report_progress
        Progress callback: number of stages done, number of stages.

    Raises
    ------
    BadInput
        Where `out` exists, or `run` is not a recording.
    RigError
        Where the folder cannot be written.
    """
    # An existing folder may hold files that the user edited: never overwritten.
    if out.exists():
        raise BadInput(
            f"{out}: is there already; name a folder that does not exist yet, or take this one away"
        )
    stage_rows: list[dict[str, Any]] = []
    stored = open_stored(run)
    with translate_os_errors(out, "cannot be written"):
        make_folder_atomically(
            out, lambda folder: stage_rows.extend(_write_folder(stored, folder, report_progress))
        )
    return ExportedCsv(
        len(stage_rows), sum(row["records"] for row in stage_rows), (out / CAMPAIGN).is_file()
    )


def _write_folder(
    stored: StoredRecording, folder: Path, report_progress: ProgressCount
) -> list[dict[str, Any]]:
    (folder / "stages").mkdir()
    rows = list(_write_stages(stored, folder, report_progress))
    index_rows = []
    for row in rows:
        index_rows.append([row.get(name, "") for name in INDEX])
    _write_csv(folder / "stages.csv", INDEX, index_rows)
    if stored.static:
        std_names = list(dict.fromkeys(name for means in stored.static for name in means.std))
        static = [
            {**static_row(means), **_what_runs_have(means, std_names)} for means in stored.static
        ]
        _write_csv(folder / "static.csv", list(static[0]), (list(row.values()) for row in static))
    pictures = list_pictures(stored.static)
    refuse_outside((stored.folder / name for name in pictures), [stored.folder])
    copy_pictures(pictures, stored.folder, folder)
    # Recordings without motion, and of old versions, have no nominal model.
    if all(section in stored.nominal for section in ("leg", "ground", "sensor", "drive")):
        text = _describe_campaign(stored, rows)
        (folder / CAMPAIGN).write_text(text, encoding="utf-8", newline="")
    return rows


def _describe_campaign(stored: StoredRecording, rows: Sequence[dict[str, Any]]) -> str:
    """campaign.toml for the exported files; `rows` are those of the index."""
    files: dict[int, dict[str, str]] = {}
    for row in rows:
        files.setdefault(row["number"], {})[row["device"]] = row["file"]
    known = stored.provenance
    head = {
        "format": CAMPAIGN_FORMAT,
        "title": stored.title,
        # An imported campaign says itself what it was.
        "recorded_as": known.get("recorded_as", stored.source),
    }
    about = {
        "date": known.get("started_at", ""),
        "operator": known.get("operator", "")[:MOST_ABOUT],
        "specimen": known.get("sample", "")[:MOST_ABOUT],
        "rig": known.get("rig", "")[:MOST_ABOUT],
    }
    text = [f"{key} = {format_value(value)}\n" for key, value in head.items()]
    text.append("\n" + table("about", about))
    for section, keys in stored.nominal.items():
        if section != "effects":
            text.append("\n" + table(section, keys, is_exact=True))
    text.append("\n" + table("known_to", stored.known_to, is_exact=True))
    for effect in stored.nominal.get("effects", ()):
        text.append("\n" + table("[effects]", effect, is_exact=True))
    for number, stage in enumerate(stored.strokes, start=1):
        before = stage.strokes_before
        if stored.source != "IMPORT":
            # Runs store their strokes in the order of time.
            before = number - 1
        keys = {"experiment": "dynamic", **stage.about, "strokes_before": before}
        text.append("\n" + table("[runs]", {**keys, "streams": files[number]}, is_exact=True))
    for number, stage in enumerate(stored.raw, start=len(stored.strokes) + 1):
        keys = {"experiment": "raw", "label": stage.label, **stage.about}
        # A stage in which no device gave a record has no file.
        if number in files:
            text.append("\n" + table("[runs]", {**keys, "streams": files[number]}, is_exact=True))
    if stored.static:
        text.append("\n" + table("[runs]", {"experiment": "static", "file": "static.csv"}))
    return "".join(text)


def _write_stages(
    stored: StoredRecording, folder: Path, report_progress: ProgressCount
) -> Iterator[dict[str, Any]]:
    for number, stage in enumerate(
        iterate_with_progress((*stored.strokes, *stored.raw), report_progress), start=1
    ):
        # A file per device: devices sample at different times, and joining them would need
        # resampling.
        with stage.samples.open_streams() as streams:
            for stream in streams:
                # A device's name may come from elsewhere: no path, and no longer than file systems
                # allow.
                device = re.sub(r"[^\w.-]", "_", stream.name)[:LONGEST_NAME]
                name = f"stages/{number:03d}-{device}.csv"
                if (folder / name).exists():
                    raise BadInput(
                        f"{stored.folder}: two streams of {stage.label} would both become {name}"
                    )
                _write_csv(folder / name, [TIME, *stream.columns], _records(stream))
                yield {
                    "number": number,
                    "file": name,
                    "stage": stage.label,
                    "device": stream.name,
                    "records": len(stream.t_s),
                    **stage.about,
                }


def _records(stream: StoredStream) -> Iterator[Sequence[Any]]:
    for rows in stream.blocks():
        # Python numbers: `csv` then writes the shortest text that reads back as the same 64-bit
        # float.
        columns = [column.values(rows).tolist() for column in stream.columns.values()]
        yield from zip(stream.t_s[rows].tolist(), *columns, strict=True)


def _write_csv(path: Path, heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    # newline="": the csv module writes its own line ends, and Windows would add another.
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(heads)
        writer.writerows(rows)
