"""What the control loop tells the recorder of a stage: that it begins, when it was commanded to, its samples, how it ended."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rfca_rig.recording.journal import BlockKind, JournalBlock
from rfca_rig.recording.model import StaticStage
from rfca_rig.recording.rows import ColumnForm, CommandedStart, Rows, StreamForm, packed


@dataclass(frozen=True)
class Begin:
    """A stage of which every sample is kept from now on."""

    label: str
    height_m: float
    forms: tuple[StreamForm, ...]

    def block(self) -> JournalBlock:
        return _text(BlockKind.BEGIN, asdict(self))

    @staticmethod
    def of(block: JournalBlock) -> "Begin":
        said = json.loads(block.payload)
        forms = (StreamForm(form["name"], tuple(ColumnForm(**column) for column in form["columns"])) for form in said["forms"])
        return Begin(said["label"], said["height_m"], tuple(forms))


@dataclass(frozen=True)
class StrokeCondition:
    """That the stage was a stroke, and which."""

    speed_rad_s: float
    repeat: int


@dataclass(frozen=True)
class End:
    """A stage that is done: a stroke or a static stage, or else why it was cut short."""

    stroke: StrokeCondition | None = None
    static: StaticStage | None = None
    cut_short: str = ""

    def block(self) -> JournalBlock:
        return _text(BlockKind.END, asdict(self))

    @staticmethod
    def of(block: JournalBlock) -> "End":
        said = json.loads(block.payload)
        stroke = StrokeCondition(**said["stroke"]) if said["stroke"] else None
        return End(stroke, static_stage_of(said["static"]) if said["static"] else None, said["cut_short"])


def static_stage_of(said: Mapping[str, Any]) -> StaticStage:
    """The stage from plain data, as `dataclasses.asdict` and JSON leave it."""
    values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in said.items()}
    return StaticStage(**values)


def start_block(start: CommandedStart) -> JournalBlock:
    return _text(BlockKind.START, asdict(start))


def start_of(block: JournalBlock) -> CommandedStart:
    said = json.loads(block.payload)
    return CommandedStart(said["start_s"], said["offsets"])


def samples_block(rows: Sequence[Rows]) -> JournalBlock:
    return JournalBlock(BlockKind.SAMPLES, packed(rows))


def event_block(event: Mapping[str, object]) -> JournalBlock:
    """One line for `events.jsonl`."""
    return _text(BlockKind.EVENT, event)


def _text(kind: BlockKind, content: Mapping[str, object]) -> JournalBlock:
    return JournalBlock(kind, json.dumps(content, ensure_ascii=False).encode())
