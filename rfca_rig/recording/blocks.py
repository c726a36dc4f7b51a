"""Messages of the control loop to the recorder about a stage: its begin, its commanded start, its samples, its end."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rfca_rig.recording.journal import BlockKind, JournalBlock
from rfca_rig.recording.model import StaticStage
from rfca_rig.recording.rows import ColumnForm, CommandedStart, Rows, StreamForm, pack_rows


@dataclass(frozen=True)
class Begin:
    """A stage begins; every sample is recorded from now on."""

    label: str
    height_m: float
    forms: tuple[StreamForm, ...]

    def block(self) -> JournalBlock:
        return _text(BlockKind.BEGIN, asdict(self))

    @staticmethod
    def of(block: JournalBlock) -> "Begin":
        """Raises ValueError, LookupError or TypeError for a block that no run wrote."""
        content = json.loads(block.payload)
        forms = (StreamForm(str(form["name"]), tuple(ColumnForm(**column) for column in form["columns"])) for form in content["forms"])
        begin = Begin(str(content["label"]), float(content["height_m"]), tuple(forms))
        for column in (column for form in begin.forms for column in form.columns):
            if np.dtype(column.dtype).kind not in "iuf":
                raise ValueError(f"column {column.name} is of {column.dtype}, no number")
        return begin


@dataclass(frozen=True)
class StrokeCondition:
    """Speed and repeat of a stage that was a stroke."""

    speed_rad_s: float
    repeat: int


@dataclass(frozen=True)
class End:
    """A stage ends: as a stroke, as a static stage, or cut short with the reason."""

    stroke: StrokeCondition | None = None
    static: StaticStage | None = None
    cut_short: str = ""

    def block(self) -> JournalBlock:
        return _text(BlockKind.END, asdict(self))

    @staticmethod
    def of(block: JournalBlock) -> "End":
        content = json.loads(block.payload)
        stroke = StrokeCondition(float(content["stroke"]["speed_rad_s"]), int(content["stroke"]["repeat"])) if content["stroke"] else None
        return End(stroke, static_stage_of(content["static"]) if content["static"] else None, str(content["cut_short"]))


def static_stage_of(fields: Mapping[str, Any]) -> StaticStage:
    """The stage from plain data, as `dataclasses.asdict` and JSON leave it."""
    # JSON has no tuples; the dataclass compares equal only with them.
    values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}
    return StaticStage(**values)


def start_block(start: CommandedStart) -> JournalBlock:
    return _text(BlockKind.START, asdict(start))


def start_of(block: JournalBlock) -> CommandedStart:
    content = json.loads(block.payload)
    return CommandedStart(content["start_s"], content["offsets"])


def samples_block(rows: Sequence[Rows]) -> JournalBlock:
    return JournalBlock(BlockKind.SAMPLES, pack_rows(rows))


def event_block(event: Mapping[str, object]) -> JournalBlock:
    """One line for `events.jsonl`."""
    return _text(BlockKind.EVENT, event)


def _text(kind: BlockKind, content: Mapping[str, object]) -> JournalBlock:
    return JournalBlock(kind, json.dumps(content, ensure_ascii=False).encode())
