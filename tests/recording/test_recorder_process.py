"""The recorder process: same files as without, survives its parent, and whatever it cannot keep
ends the run.
"""

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from rfca_rig.errors import BadInput, RigError, Tripped
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import RecorderClient
from rfca_rig.recording.block_queue import BlockQueue
from rfca_rig.recording.journal import frame_block
from rfca_rig.recording.recorder_process import start_recorder
from rfca_rig.recording.run_text import check_not_running
from rfca_rig.subprocesses import can_be_started
from tests.recording.growing import (
    PER_TICK,
    TICKS,
    begun,
    exhaust,
    grown,
    hand_over,
    header,
    run_blocks,
    wait_until_acknowledged,
)

pytestmark = pytest.mark.skipif(not can_be_started(), reason="no process can be started to record")
ROOT = Path(__file__).parents[2]


@pytest.fixture
def keeper(tmp_path: Path):
    run_folder.create(tmp_path / "run", header())
    keeper = RecorderClient(tmp_path / "run", patient=False, queue_bytes=200_000)
    yield keeper
    keeper._let_go() if not keeper._child.closed else None


@pytest.mark.slow
@pytest.mark.parametrize("patient", [True, False])
def test_it_writes_the_bytes_that_would_be_written_without_it(tmp_path: Path, patient: bool):
    run_folder.create(tmp_path / "run", header())
    keeper = RecorderClient(tmp_path / "run", patient)
    for number, blocks in enumerate(run_blocks(2), start=1):
        exhaust(hand_over(keeper, number, blocks))
    keeper.finish("done")
    assert keeper.acknowledged == 2
    grown(tmp_path / "same", 2).finish("done")
    files = [
        file.relative_to(tmp_path / "run")
        for file in (tmp_path / "run").rglob("*")
        if file.is_file()
    ]
    assert len(files) == 5
    if not patient:
        files.remove(
            Path("events.jsonl")
        )  # in which the next stage may begin before the file of the last is there
    assert {file: (tmp_path / "run" / file).read_bytes() for file in files} == {
        file: (tmp_path / "same" / file).read_bytes() for file in files
    }


def test_one_that_is_started_in_advance_ends_without_a_run():
    process, connection = start_recorder()
    connection.close()
    assert process.wait(60.0) == 0


def test_one_that_is_started_in_advance_records(tmp_path: Path):
    run_folder.create(tmp_path / "run", header())
    started = start_recorder()
    keeper = RecorderClient(tmp_path / "run", patient=False, started=started)
    assert keeper.process_id == started[0].pid
    (blocks,) = run_blocks(1)
    exhaust(hand_over(keeper, 1, blocks))
    keeper.finish("done")
    assert keeper.acknowledged == 1


def test_finishing_again_does_nothing(keeper: RecorderClient):
    keeper.finish("done")
    keeper.finish("done")
    assert keeper.acknowledged == 0


def test_a_recorder_that_cannot_keep_up_trips_and_loses_nothing_in_silence(
    tmp_path: Path, keeper: RecorderClient
):
    os.kill(keeper.process_id, signal.SIGSTOP)
    given = 0
    try:
        with pytest.raises(
            Tripped,
            match=(
                r"the recorder is 0\.2 MB behind and its queue is full: the disk under .*/run "
                r"is too slow"
            ),
        ):
            for block in begun(1, ticks=10**4):
                keeper.give(block)
                given += 1
    finally:
        os.kill(keeper.process_id, signal.SIGCONT)
    keeper.finish("the recorder is behind")
    (raw,) = run_folder.read_stages(tmp_path / "run").raw
    assert len(raw.streams["shaft"].t_s) == given - 3, (
        "all but the three blocks that are no samples"
    )
    assert raw.cut_short == "the recorder is behind"


def test_a_patient_caller_waits_for_room(tmp_path: Path):
    run_folder.create(tmp_path / "run", header())
    keeper = RecorderClient(tmp_path / "run", patient=True, queue_bytes=20_000)
    for block in begun(1, ticks=500):
        keeper.give(block)
    keeper.finish("done")
    (raw,) = run_folder.read_stages(tmp_path / "run").raw
    assert len(raw.streams["force"].t_s) == 500 * PER_TICK


def test_a_recorder_that_dies_is_noticed_at_the_next_tick(tmp_path: Path, keeper: RecorderClient):
    first, second = run_blocks(2)
    for block in first:
        keeper.give(block)
    wait_until_acknowledged(keeper, 1)
    os.kill(keeper.process_id, signal.SIGKILL)
    keeper._process.wait()
    with pytest.raises(RigError, match=r"recorder has ended by itself; .*rfca-rig recover"):
        keeper.give(second[0])
    with pytest.raises(RigError, match="ended by itself"):
        keeper.finish("the recorder has ended")
    assert len(run_folder.read_stages(tmp_path / "run").strokes) == 1


def test_a_second_writer_is_refused(tmp_path: Path, keeper: RecorderClient):
    with pytest.raises(RigError, match="still going on"):
        RecorderClient(tmp_path / "run", patient=False)
    keeper.finish("done")


def test_the_death_of_the_control_process_costs_nothing_that_it_had_handed_over(tmp_path: Path):
    program = f"""
        import os
        from pathlib import Path
        from rfca_rig.recording import run_folder
        from rfca_rig.recording.backend import RecorderClient
        from tests.recording.growing import begun, header
        folder = Path({str(tmp_path / "run")!r})
        run_folder.create(folder, header())
        keeper = RecorderClient(folder, patient=False)
        for block in begun(1):
            keeper.give(block)
        os._exit(9)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], cwd=ROOT, check=False)
    assert done.returncode == 9
    _wait_until_over(tmp_path / "run")
    (raw,) = run_folder.read_stages(tmp_path / "run").raw
    assert len(raw.streams["force"].t_s) == TICKS * PER_TICK
    assert raw.cut_short == "the control process ended"


def _wait_until_over(folder: Path) -> None:
    for _ in range(300):
        try:
            check_not_running(folder)
        except BadInput:
            time.sleep(0.1)
        else:
            return
    raise AssertionError("the recorder goes on")


def test_the_queue_gives_back_what_was_put_and_refuses_what_does_not_fit():
    queue = BlockQueue.create(1000)
    blocks = [frame_block(block) for block in begun(1)][3:]
    put = taken = b""
    for block in blocks * 20:
        if not queue.put(block):
            assert len(block) > queue.size - queue.waiting
            found = queue.look()
            queue.consume(len(found))
            taken += found
            assert queue.put(block)
        put += block
    assert taken + queue.look() == put
    queue.remove()
