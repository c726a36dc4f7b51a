"""A process that dies at any of its writes, a power cut at any byte: what was acknowledged is
there, what was under way nearly so.
"""

import os
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from rfca_rig.engine.run import run_plan
from rfca_rig.errors import BadInput
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import InProcessRecorder
from rfca_rig.recording.checking import check_run
from rfca_rig.recording.journal import BlockKind, JournalBlock, frame_block
from rfca_rig.recording.layout import journals
from rfca_rig.recording.model import Recording
from rfca_rig.recording.run_text import Ending, write_ending
from rfca_rig.recording.store import read_recording
from tests.engine.rigs import nothing, one_condition, recorder_on, twin_rig
from tests.recording.dying import STAGE, TICK, Promised, calls_of, killed_at
from tests.recording.growing import (
    PER_TICK,
    TICKS,
    begun,
    expected,
    grown,
    hand_over,
    header,
    picture,
    run_blocks,
    static_stage,
    stroke_blocks,
)
from tests.recording.same import assert_same

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="a child is made by fork")

STAGES = 3


def whole_run(folder: Path, first: Recording, stages: Sequence[Sequence[JournalBlock]]):
    """A run from its first file to its last, which tells what was handed over, and each stage
    that is acknowledged.
    """

    def work(tell) -> None:
        run_folder.create(folder, first)
        keeper = InProcessRecorder(folder)
        for number, blocks in enumerate(stages, start=1):
            for block in hand_over(keeper, number, blocks):
                if block.kind is BlockKind.SAMPLES:
                    tell(TICK)
            assert keeper.acknowledged == number
            tell(STAGE)
        keeper.finish("done")
        write_ending(folder, Ending({"ended": "done"}))
        run_folder.build_recording(folder)

    return work


def recovered(folder: Path) -> Recording:
    run_folder.close_journals(folder)
    found = read_recording(run_folder.build_recording(folder))
    assert all(finding.is_sound for finding in check_run(folder)), list(check_run(folder))
    assert not [
        file
        for file in folder.rglob("*")
        if file.suffix in (".writing", ".journal") or file.name == ".ballast"
    ]
    return replace(found, nominal={}, known_to={}, provenance={})


def first_stages(whole: Recording, count: int) -> Recording:
    """Of strokes and static stages in turn."""
    return replace(
        whole,
        strokes=whole.strokes[: (count + 1) // 2],
        static=whole.static[: count // 2],
        raw=whole.raw[: count // 2],
    )


def survives(folder: Path, call: int) -> int:
    """Dies at that call of a small run, and is recovered. Returns how many stages had been
    acknowledged.
    """
    promised = killed_at(call, whole_run(folder, header(), run_blocks(STAGES)))
    safe = promised.stages
    if not run_folder.is_run(folder):
        assert promised == Promised(0, 0)
        return 0
    for number in range(2, safe + 1, 4):
        assert np.array_equal(
            cv2.imread(str(folder / static_stage(number).photo)), picture(number)
        ), "the photo of an acknowledged stage"
    before = run_folder.read_stages(folder)
    assert len(before.strokes) + len(before.static) >= safe, (
        "readable even before anything is recovered"
    )
    found = recovered(folder)
    done = len(found.strokes) + len(found.static)
    assert safe <= done <= safe + 1
    cut_short = [raw for raw in found.raw if raw.cut_short]
    assert_same(
        replace(found, raw=tuple(raw for raw in found.raw if not raw.cut_short)),
        first_stages(expected(STAGES), done),
    )
    assert len(cut_short) <= 1
    assert promised.ticks <= ticks_in(found) <= promised.ticks + 1
    return safe


def ticks_in(found: Recording) -> int:
    """Of the stages of `growing`: one sample of the shaft each."""
    streams = [*(stroke.streams for stroke in found.strokes), *(raw.streams for raw in found.raw)]
    return sum(len(some["shaft"].t_s) for some in streams)


@pytest.mark.slow
def test_a_run_killed_at_any_of_twenty_writes_loses_no_acknowledged_stage(tmp_path: Path):
    calls = calls_of(whole_run(tmp_path / "calls", header(), run_blocks(STAGES)))
    safe = [
        survives(tmp_path / str(call), int(call)) for call in np.linspace(2, calls, 20, dtype=int)
    ]
    assert {0, 1, 2, 3} == set(safe)


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_a_run_killed_at_every_write_loses_no_acknowledged_stage(tmp_path: Path):
    calls = calls_of(whole_run(tmp_path / "calls", header(), run_blocks(STAGES)))
    assert calls > 200
    for call in range(1, calls + 1):
        survives(tmp_path / str(call), call)
        shutil.rmtree(tmp_path / str(call), ignore_errors=True)


class Collecting(InProcessRecorder):
    """Keeps the blocks of each stage as well as the run."""

    def __init__(self, keeper: InProcessRecorder) -> None:
        self._keeper = keeper
        self.stages: list[list[JournalBlock]] = [[]]

    def give(self, block: JournalBlock) -> None:
        self._keeper.give(block)
        self.stages[-1].append(block)
        if block.kind is BlockKind.END:
            self.stages.append([])


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_run_on_the_twin_killed_at_over_200_writes_loses_no_acknowledged_stage(tmp_path: Path):
    rig = twin_rig()
    with recorder_on(rig, tmp_path / "twin") as (bench, recorder, kept):
        recorder._keeper = Collecting(kept.keeper)
        run_plan(one_condition(rig, 2), bench, recorder, nothing)
        stages = recorder._keeper.stages[:-1]
        whole = kept.finish()
    calls = calls_of(whole_run(tmp_path / "calls", header(), stages))
    lost = 0
    points = sorted(
        {
            *np.linspace(1, calls, 190, dtype=int).tolist(),
            *range(1, 12),
            *range(calls - 25, calls + 1),
        }
    )
    assert len(points) > 200
    for call in points:
        folder = tmp_path / str(call)
        safe = killed_at(call, whole_run(folder, header(), stages)).stages
        if run_folder.is_run(folder):
            found = recovered(folder).strokes
            lost += max(safe - len(found), 0)
            assert_same(
                replace(header(), strokes=found),
                replace(header(), strokes=whole.strokes[: len(found)]),
            )
        else:
            lost += safe
        shutil.rmtree(folder, ignore_errors=True)
    assert lost == 0


def crashed(folder: Path) -> Path:
    """A run of two stages that dies within its third, and the journal of that."""
    keeper = grown(folder, 2)
    for block in begun(3):
        keeper.give(block)
    keeper._writer._events.close()  # as the death of its process does
    (journal,) = journals(folder)
    return journal


def test_a_crash_within_a_stage_costs_none_of_the_samples_handed_over(tmp_path: Path):
    crashed(tmp_path / "run")
    found = recovered(tmp_path / "run")
    assert len(found.strokes) + len(found.static) == 2
    assert len(found.raw[-1].streams["force"].t_s) == TICKS * PER_TICK
    assert found.raw[-1].cut_short == "the recording was interrupted"


def cut_at(folder: Path, copy: Path, place: int, ends: np.ndarray) -> None:
    """The journal cut at a byte gives back all blocks before, and the stages before as they
    were.
    """
    shutil.copytree(folder, copy)
    (journal,) = journals(copy)
    os.truncate(journal, place)
    found = recovered(copy)
    assert len(found.strokes) + len(found.static) == 2
    ticks = sum(
        1
        for end, block in zip(ends, list(begun(3))[1:], strict=True)
        if end <= place and block.kind is BlockKind.SAMPLES
    )
    kept = [len(raw.streams["force"].t_s) for raw in found.raw if raw.cut_short]
    assert kept == ([ticks * PER_TICK] if ticks else [])
    shutil.rmtree(copy)


def places(folder: Path, count: int) -> tuple[np.ndarray, np.ndarray]:
    ends = np.cumsum([len(frame_block(block)) for block in list(begun(3))[1:]])
    assert ends[-1] == crashed(folder).stat().st_size
    return np.unique(np.linspace(0, ends[-1], count, dtype=int)), ends


@pytest.mark.slow
def test_a_journal_cut_at_any_of_six_bytes(tmp_path: Path):
    where, ends = places(tmp_path / "run", 6)
    for place in where:
        cut_at(tmp_path / "run", tmp_path / "copy", int(place), ends)


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_a_journal_cut_at_over_200_bytes(tmp_path: Path):
    where, ends = places(tmp_path / "run", 12)
    for place in sorted(
        {*range(0, int(ends[-1]), 37), *where.tolist(), *ends.tolist(), *(ends - 1).tolist()}
    ):
        cut_at(tmp_path / "run", tmp_path / "copy", place, ends)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.3, 0.999])
def test_a_stage_file_half_written_is_passed_over_and_its_journal_taken(
    tmp_path: Path, share: float
):
    journal = crashed(tmp_path / "run")
    whole = (tmp_path / "run" / "stages" / "0001.h5").read_bytes()
    journal.with_name("0003.h5.writing").write_bytes(whole[: int(share * len(whole))])
    found = recovered(tmp_path / "run")
    assert len(found.raw[-1].streams["force"].t_s) == TICKS * PER_TICK


@pytest.mark.slow
def test_recovering_twice_gives_the_same_bytes(tmp_path: Path):
    crashed(tmp_path / "run")
    shutil.copytree(tmp_path / "run", tmp_path / "copy")
    for folder in ("run", "copy"):
        recovered(tmp_path / folder)
    one, other = ((tmp_path / folder / "run.h5").read_bytes() for folder in ("run", "copy"))
    assert one == other


def test_a_journal_of_nonsense_in_whole_blocks_is_one_line(tmp_path: Path):
    journal = crashed(tmp_path / "run")
    journal.write_bytes(frame_block(JournalBlock(BlockKind.BEGIN, b"{}")))
    with pytest.raises(BadInput, match=r"0003\.journal: is no journal of a stage"):
        recovered(tmp_path / "run")


@pytest.mark.slow
@pytest.mark.parametrize("steps", [0, 1, 3])
def test_a_crash_while_the_file_of_one_stage_is_made_and_the_next_goes_on_costs_neither(
    tmp_path: Path, steps: int
):
    """As on a real rig, whose next stage does not wait."""
    keeper = grown(tmp_path / "run", 2)
    writer = keeper._writer
    whole = list(stroke_blocks(3))
    for number, block in enumerate([*whole, *begun(4)]):
        writer.take(block)
        writer.flush()
        if number >= len(whole) and number < len(whole) + steps:
            assert writer.work()
    assert writer.acknowledged == 2
    writer._events.close()  # as the death of its process does
    assert len(journals(tmp_path / "run")) == 2
    found = recovered(tmp_path / "run")
    assert_same(replace(found, raw=found.raw[:1]), expected(3))
    assert (found.raw[1].label, len(found.raw[1].streams["shaft"].t_s)) == ("stage 4", TICKS)
