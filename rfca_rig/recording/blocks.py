"""What the control loop tells the recorder of a stage: that it begins, when it was commanded to, its samples, how it ended."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rfca_rig.recording.journal import Block, Kind
from rfca_rig.recording.model import StaticStage
from rfca_rig.recording.rows import ColumnForm, Rows, Start, StreamForm, packed


@dataclass(frozen=True)
class Begin:
    """A stage of which every sample is kept from now on."""

    label: str
    height_m: float
    forms: tuple[StreamForm, ...]

    def block(self) -> Block:
        return _text(Kind.BEGIN, asdict(self))

    @staticmethod
    def of(block: Block) -> "Begin":
        said = json.loads(block.payload)
        forms = (StreamForm(form["name"], tuple(ColumnForm(**column) for column in form["columns"])) for form in said["forms"])
        return Begin(said["label"], said["height_m"], tuple(forms))


@dataclass(frozen=True)
class Condition:
    """That the stage was a stroke, and which."""

    speed_rad_s: float
    repeat: int


@dataclass(frozen=True)
class End:
    """A stage that is done: a stroke or a static stage, or else why it was cut short."""

    stroke: Condition | None = None
    static: StaticStage | None = None
    cut_short: str = ""

    def block(self) -> Block:
        return _text(Kind.END, asdict(self))

    @staticmethod
    def of(block: Block) -> "End":
        said = json.loads(block.payload)
        stroke = Condition(**said["stroke"]) if said["stroke"] else None
        return End(stroke, static_stage_of(said["static"]) if said["static"] else None, said["cut_short"])


def static_stage_of(said: Mapping[str, Any]) -> StaticStage:
    """The stage from plain data, as `dataclasses.asdict` and JSON leave it."""
    values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in said.items()}
    return StaticStage(**values)


def start_block(start: Start) -> Block:
    return _text(Kind.START, asdict(start))


def start_of(block: Block) -> Start:
    said = json.loads(block.payload)
    return Start(said["start_s"], said["offsets"])


def samples_block(rows: Sequence[Rows]) -> Block:
    return Block(Kind.SAMPLES, packed(rows))


def event_block(event: Mapping[str, object]) -> Block:
    """One line for `events.jsonl`."""
    return _text(Kind.EVENT, event)


def _text(kind: Kind, content: Mapping[str, object]) -> Block:
    return Block(kind, json.dumps(content, ensure_ascii=False).encode())
