"""Stages longer than a piece: whole to the last bit, in run.h5 as in their own file, and with no
more memory than a short one.
"""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.recording import journal as journal_module
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import InProcessRecorder
from rfca_rig.recording.columns import ROWS_PER_CHUNK, Rows, make_stream_from_rows
from rfca_rig.recording.hdf5_file import run_to_completion
from rfca_rig.recording.journal import (
    Begin,
    End,
    StrokeCondition,
    frame_block,
    parse_blocks,
    read_blocks,
    samples_block,
    start_block,
)
from rfca_rig.recording.layout import stage_files
from rfca_rig.recording.model import Stroke
from rfca_rig.recording.stage_file import write_stage
from rfca_rig.recording.store import read_recording, summarize
from tests.recording.growing import FORCE, FORMS, SHAFT, SPEED, START, WRENCH, begun, header
from tests.recording.same import assert_same

LENGTHS = (7, 5000, ROWS_PER_CHUNK, 0, 3 * ROWS_PER_CHUNK + 11, 1)


def rows(number: int, force_length: int) -> tuple[Rows, Rows]:
    random = np.random.default_rng(number)
    shaft = np.zeros(number, SHAFT.dtype)
    force = np.zeros(force_length, FORCE.dtype)
    for some in (shaft, force):
        some["device_s"] = number + np.arange(len(some)) / 1e5
        some["host_s"] = some["device_s"] + 100.0 + random.uniform(0.0, 1e-3, len(some))
    shaft["shaft_angle_rad"] = random.normal(size=len(shaft))
    for name in WRENCH:
        force[name] = random.integers(-(2**31), 2**31, force_length)
    return shaft, force


def test_a_stage_of_several_pieces_is_what_was_handed_over(tmp_path: Path):
    run_folder.create(tmp_path / "run", header())
    keeper = InProcessRecorder(tmp_path / "run")
    pieces = [rows(number, length) for number, length in enumerate(LENGTHS)]
    keeper.give(Begin("long", 0.215, FORMS).block())
    keeper.give(start_block(START))
    for piece in pieces:
        keeper.give(samples_block(piece))
    keeper.give(End(stroke=StrokeCondition(SPEED, 1)).block())
    keeper.finish("done")
    streams = {
        form.name: make_stream_from_rows(form, np.concatenate(some), START)
        for form, some in zip(FORMS, zip(*pieces, strict=True), strict=True)
    }
    expected = replace(header(), strokes=(Stroke(0.215, SPEED, 1, streams),))
    (stage,) = stage_files(tmp_path / "run")
    for path in (stage, run_folder.build_recording(tmp_path / "run")):
        found = read_recording(path)
        assert_same(
            replace(
                found,
                nominal=expected.nominal,
                known_to=expected.known_to,
                provenance=expected.provenance,
            ),
            expected,
        )
    assert summarize(stage).samples == {"shaft": sum(range(len(LENGTHS))), "force": sum(LENGTHS)}


@pytest.mark.parametrize("piece", [1, 13, 700, 1 << 20])
def test_a_journal_is_read_in_pieces_of_any_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, piece: int
):
    monkeypatch.setattr(journal_module, "PIECE", piece)
    content = b"".join(frame_block(block) for block in begun(1))
    path = tmp_path / "a.journal"
    random = np.random.default_rng(piece)
    for place in [0, 5, len(content), *random.integers(0, len(content), 12)]:
        damaged = bytearray(content)
        damaged[place % len(content)] ^= 16
        for there in (content[:place], bytes(damaged)):
            path.write_bytes(there)
            assert list(read_blocks(path)) == parse_blocks(there)[0]


def journal_of(path: Path, blocks: int) -> int:
    """Its length."""
    samples = frame_block(samples_block(rows(1, 1000)))
    begin = frame_block(Begin("long", 0.215, FORMS).block())
    path.write_bytes(begin + samples * blocks)
    return path.stat().st_size


@pytest.mark.slow
def test_the_length_of_a_stage_costs_no_memory(tmp_path: Path):
    peaks = []
    for number, blocks in enumerate((60, 480)):
        journal = tmp_path / f"000{number + 1}.journal"
        length = journal_of(journal, blocks)
        tracemalloc.start()
        run_to_completion(write_stage(journal, journal.with_suffix(".h5"), header()))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert length > 2e7
    assert peaks[1] < 8e6
    assert peaks[1] < 1.3 * peaks[0]
