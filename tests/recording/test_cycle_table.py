"""The table of cycles on disk: small, whole block by block, and of a block in progress all but
what was not written yet.
"""

from pathlib import Path

import numpy as np
import pytest

from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import InProcessRecorder
from rfca_rig.recording.journal import Begin, End, frame_block, samples_block
from rfca_rig.recording.layout import journals, stage_files
from rfca_rig.recording.run_folder import close_journals, read_stages
from rfca_rig.recording.tables import CYCLE_FORM, cycle_row, cycle_table
from tests.recording.growing import header

BYTES_PER_CYCLE = 100  # a million are 100 MB


def row(number, random):
    return samples_block(
        (
            cycle_row(
                number, (50.0 + random.normal(), 7.0, -43.0, 6.0), 1.047 * number, 1.047 * number
            ),
        )
    )


def begun(folder, first, count):
    """A keeper in the middle of a block of cycles."""
    random = np.random.default_rng(first)
    keeper = InProcessRecorder(folder)
    keeper.give(Begin(f"cycles {first}", 0.2228, (CYCLE_FORM,)).block())
    for number in range(first, first + count):
        keeper.give(row(number, random))
    return keeper


def test_blocks_of_cycles_are_one_table_and_a_million_stay_below_100_MB(tmp_path: Path):
    run_folder.create(tmp_path / "run", header())
    for first in (1, 999_001):
        keeper = begun(tmp_path / "run", first, 1000)
        assert journals(tmp_path / "run")[0].stat().st_size < 1000 * BYTES_PER_CYCLE
        keeper.give(End().block())
        keeper.finish("done")
    table = cycle_table(read_stages(tmp_path / "run"))
    assert table.numbers.tolist() == [*range(1, 1001), *range(999_001, 1_000_001)]
    assert table.peak_force_N[0] == pytest.approx(
        50.0 + np.random.default_rng(1).normal(), rel=1e-6
    )
    assert (
        sum(file.stat().st_size for file in stage_files(tmp_path / "run")) < 2000 * BYTES_PER_CYCLE
    )


def test_what_of_a_block_was_written_is_counted_wherever_the_power_went(tmp_path: Path):
    run_folder.create(tmp_path / "run", header())
    begun(tmp_path / "run", 1, 5)
    (journal,) = journals(tmp_path / "run")
    content = journal.read_bytes()
    length = len(frame_block(row(1, np.random.default_rng(0))))
    for lost in range(0, 2 * length + 1, 7):
        folder = tmp_path / f"lost{lost}"
        run_folder.create(folder, header())
        (folder / "stages" / "0001.journal").write_bytes(content[: len(content) - lost])
        close_journals(folder)
        assert cycle_table(read_stages(folder)).numbers.tolist() == list(
            range(1, 6 - -(-lost // length))
        )


def test_a_run_without_cycles_has_an_empty_table(tmp_path: Path):
    run_folder.create(tmp_path / "run", header())
    table = cycle_table(read_stages(tmp_path / "run"))
    assert (len(table.numbers), table.numbers.dtype, len(table.peak_force_N)) == (
        0,
        np.dtype("<u4"),
        0,
    )
