"""Runs as the control loop hands them over, block by block: counts from the sensor, floats from
the drive.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import InProcessRecorder, RunBackend
from rfca_rig.recording.columns import (
    ColumnForm,
    CommandedStart,
    Rows,
    StreamForm,
    make_stream_from_rows,
)
from rfca_rig.recording.journal import (
    Begin,
    BlockKind,
    End,
    JournalBlock,
    StrokeCondition,
    event_block,
    samples_block,
    start_block,
)
from rfca_rig.recording.model import RawStage, Recording, StaticStage, Stroke
from tests.recording.samples import WRENCH, recording, stage

CLOCKS = (ColumnForm("host_s", "<f8", "s"), ColumnForm("device_s", "<f8", "s"))
SHAFT = StreamForm("shaft", (ColumnForm("shaft_angle_rad", "<f8", "rad"), *CLOCKS))
FORCE = StreamForm(
    "force",
    (
        *(ColumnForm(name, "<i4", "N", 1e-6) for name in WRENCH),
        ColumnForm("status", "<u4", ""),
        *CLOCKS,
    ),
)
FORMS = (SHAFT, FORCE)
START = CommandedStart(100.25, {"shaft_angle_rad": -6.25})
TICKS = 12
PER_TICK = 14
SPEED = 2.433


def tick(repeat: int, number: int) -> tuple[Rows, Rows]:
    """What the devices report in one tick."""
    random = np.random.default_rng([repeat, number])
    shaft = np.zeros(1, SHAFT.dtype)
    force = np.zeros(PER_TICK, FORCE.dtype)
    for rows, rate_Hz in ((shaft, 500.0), (force, 7000.0)):
        rows["device_s"] = (number * len(rows) + np.arange(len(rows))) / rate_Hz
        rows["host_s"] = rows["device_s"] + 100.0 + random.uniform(0.0, 1e-3, len(rows))
    shaft["shaft_angle_rad"] = random.normal(size=1)
    for name in WRENCH:
        force[name] = random.integers(-(2**31), 2**31, PER_TICK)
    return shaft, force


def streams(repeat: int, ticks: int = TICKS):
    pieces = [tick(repeat, number) for number in range(ticks)]
    return {
        form.name: make_stream_from_rows(form, np.concatenate(some), START)
        for form, some in zip(FORMS, zip(*pieces, strict=True), strict=True)
    }


def stroke(repeat: int) -> Stroke:
    """What `stroke_blocks` should become."""
    return Stroke(0.215, SPEED, repeat, streams(repeat))


def begun(repeat: int, ticks: int = TICKS) -> Iterator[JournalBlock]:
    """A stage up to a tick."""
    yield event_block({"event": "stage begins", "stage": f"stage {repeat}"})
    yield Begin(f"stage {repeat}", 0.215, FORMS).block()
    for number in range(ticks):
        if number == 3:
            yield start_block(START)
        yield samples_block(tick(repeat, number))


def stroke_blocks(repeat: int) -> Iterator[JournalBlock]:
    yield from begun(repeat)
    yield End(stroke=StrokeCondition(SPEED, repeat)).block()


def static_stage(number: int) -> StaticStage:
    """Every second one has a photo, every fourth none; each is the next of its run."""
    return replace(
        stage(number), photo=f"photos/{number // 4 + 1:03d}.png" if number % 4 == 2 else ""
    )


def picture(number: int) -> np.ndarray:
    """What the photo of a static stage shows."""
    return np.random.default_rng(number).integers(0, 255, (20, 30, 3), dtype=np.uint8)


def static_blocks(number: int) -> Iterator[JournalBlock]:
    yield from begun(number)
    yield End(static=static_stage(number)).block()


def hand_over(
    keeper: RunBackend, number: int, blocks: Sequence[JournalBlock]
) -> Iterator[JournalBlock]:
    """The blocks of stage `number` of a run, each yielded once it is handed over; the photo
    before the end, as the rig does.
    """
    for block in blocks:
        if block.kind is BlockKind.END and number % 4 == 2:
            assert keeper.keep_photo(picture(number)) == static_stage(number).photo
        keeper.give(block)
        yield block


def run_blocks(count: int) -> list[Sequence[JournalBlock]]:
    """Strokes and static stages in turn."""
    return [
        list(stroke_blocks(number) if number % 2 else static_blocks(number))
        for number in range(1, count + 1)
    ]


def expected(count: int) -> Recording:
    """What the first so many stages of `run_blocks` should become."""
    odd = range(1, count + 1, 2)
    even = range(2, count + 1, 2)
    raw = tuple(RawStage(f"stage {number}", 0.215, streams(number)) for number in even)
    return Recording(
        "Flügel 1",
        "SIM",
        {},
        {},
        tuple(stroke(number) for number in odd),
        tuple(static_stage(number) for number in even),
        {},
        raw,
    )


def header() -> Recording:
    return recording(0, 0)


def grown(folder: Path, count: int) -> InProcessRecorder:
    """A run with so many stages, still open."""
    run_folder.create(folder, header())
    keeper = InProcessRecorder(folder)
    for number, blocks in enumerate(run_blocks(count), start=1):
        exhaust(hand_over(keeper, number, blocks))
    return keeper


def exhaust(blocks: Iterator[JournalBlock]) -> None:
    """All of them handed over."""
    for _ in blocks:
        pass


def wait_until_acknowledged(keeper: RunBackend, count: int) -> None:
    """For at most half a minute."""
    for _ in range(3000):
        if keeper.acknowledged >= count:
            return
        time.sleep(0.01)
    raise AssertionError(f"{keeper.acknowledged} stages acknowledged, where {count} were given")
