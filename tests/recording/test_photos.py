"""A stage with a photo is acknowledged when the photo, too, is on disk; a crash costs no more
than that of the stage in flight.
"""

import subprocess
import sys
import textwrap
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from rfca_rig.errors import RigError
from rfca_rig.recording import run_folder, run_writer
from rfca_rig.recording.backend import InProcessRecorder, RecorderClient
from rfca_rig.recording.run_text import events_of
from rfca_rig.recording.run_writer import PhotoSender
from rfca_rig.subprocesses import can_be_started
from tests.recording.growing import (
    exhaust,
    grown,
    hand_over,
    header,
    run_blocks,
    static_blocks,
    wait_until_acknowledged,
)
from tests.recording.growing import picture as picture_of
from tests.recording.test_recorder_process import ROOT, _wait_until_over

needs_process = pytest.mark.skipif(
    not can_be_started(), reason="no process can be started to record"
)
PICTURES = [picture_of(number) for number in range(3)]


def keeper_of(kind: type, folder: Path) -> InProcessRecorder | RecorderClient:
    run_folder.create(folder, header())
    if kind is InProcessRecorder:
        return InProcessRecorder(folder)
    return RecorderClient(folder, patient=False)


@pytest.mark.parametrize(
    "kind", [InProcessRecorder, pytest.param(RecorderClient, marks=needs_process)]
)
def test_every_picture_is_there_as_it_was(tmp_path: Path, kind: type):
    keeper = keeper_of(kind, tmp_path / "run")
    names = [keeper.keep_photo(picture) for picture in PICTURES]
    keeper.finish("done")
    assert names == ["photos/001.png", "photos/002.png", "photos/003.png"]
    for name, kept in zip(names, PICTURES, strict=True):
        assert np.array_equal(cv2.imread(str(tmp_path / "run" / name)), kept)
    assert sorted(file.name for file in (tmp_path / "run" / "photos").iterdir()) == [
        "001.png",
        "002.png",
        "003.png",
    ]


@pytest.mark.slow
@needs_process
def test_a_large_photo_from_a_camera_that_gives_it_turned_round_is_as_it_was(tmp_path: Path):
    """Larger than the queue, and not in one piece in memory."""
    large = np.random.default_rng(1).integers(0, 255, (3000, 2000, 3), dtype=np.uint8)[::-1, ::-1]
    keeper = keeper_of(RecorderClient, tmp_path / "run")
    name = keeper.keep_photo(large)
    keeper.finish("done")
    assert np.array_equal(cv2.imread(str(tmp_path / "run" / name)), large)


def test_a_run_without_photos_has_no_folder_of_them(tmp_path: Path):
    grown(tmp_path / "run", 1).finish("done")
    assert not (tmp_path / "run" / "photos").exists()


def test_a_run_that_goes_on_numbers_them_on(tmp_path: Path):
    grown(tmp_path / "run", 2).finish("the power went")
    keeper = InProcessRecorder(tmp_path / "run")
    assert keeper.keep_photo(PICTURES[0]) == "photos/002.png"
    keeper.finish("done")


def test_a_stage_whose_photo_the_disk_refuses_is_kept_and_never_acknowledged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def refuse(path: Path, _content: bytes) -> None:
        raise RigError(f"{path}: cannot be written: Input/output error")

    keeper = grown(tmp_path / "run", 1)
    monkeypatch.setattr(run_writer, "write_atomically", refuse)
    with pytest.raises(RigError, match="Input/output error"):
        keeper.keep_photo(PICTURES[0])
    for block in static_blocks(2):
        keeper.give(block)
    assert keeper.acknowledged == 1
    keeper.finish("the photo was refused")
    assert len(run_folder.read_stages(tmp_path / "run").static) == 1
    assert [event["photo"] for event in events_of(tmp_path / "run") if "photo" in event] == [
        "photos/001.png is lost"
    ]


def slowly(work):
    def slow(*words) -> None:
        time.sleep(0.5)
        work(*words)

    return slow


@needs_process
def test_when_a_stage_is_acknowledged_its_photo_is_on_disk_however_long_that_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(PhotoSender, "_work", slowly(PhotoSender._work))
    keeper = keeper_of(RecorderClient, tmp_path / "run")
    first, second = run_blocks(2)
    exhaust(hand_over(keeper, 1, first))
    exhaust(hand_over(keeper, 2, second))
    wait_until_acknowledged(keeper, 2)
    assert np.array_equal(cv2.imread(str(tmp_path / "run" / "photos" / "001.png")), picture_of(2))
    keeper.finish("done")


@needs_process
def test_a_control_process_that_dies_before_its_photo_is_through_loses_that_photo_and_nothing_else(
    tmp_path: Path,
):
    program = f"""
        import os
        from pathlib import Path
        from rfca_rig.recording import run_folder
        from rfca_rig.recording.run_writer import PhotoSender
        from rfca_rig.recording.backend import RecorderClient
        from tests.recording.growing import (
            exhaust,
            hand_over,
            header,
            run_blocks,
            wait_until_acknowledged,
        )
        folder = Path({str(tmp_path / "run")!r})
        run_folder.create(folder, header())
        keeper = RecorderClient(folder, patient=False)
        for number, blocks in enumerate(run_blocks(2), start=1):
            exhaust(hand_over(keeper, number, blocks))
        wait_until_acknowledged(keeper, 2)
        PhotoSender.send = lambda sender, name, picture: None
        exhaust(hand_over(keeper, 6, run_blocks(6)[5]))
        os._exit(9)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], cwd=ROOT, check=False)
    assert done.returncode == 9
    _wait_until_over(tmp_path / "run")
    found = run_folder.read_stages(tmp_path / "run")
    assert [stage.stage for stage in found.static] == [2, 6]
    assert [event["photo"] for event in events_of(tmp_path / "run") if "photo" in event] == [
        "photos/002.png is lost"
    ]
    assert np.array_equal(cv2.imread(str(tmp_path / "run" / "photos" / "001.png")), picture_of(2))


@needs_process
def test_where_no_thread_can_be_started_the_photo_is_lost_and_not_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def refuse(_: PhotoSender) -> None:
        raise RuntimeError("can't start new thread")

    run_folder.create(tmp_path / "run", header())
    lines: list[str] = []
    keeper = RecorderClient(tmp_path / "run", patient=False, warn=lines.append)
    with monkeypatch.context() as patch:
        patch.setattr(PhotoSender, "start", refuse)
        assert keeper.keep_photo(PICTURES[0]) == ""
    assert keeper.keep_photo(PICTURES[1]) == "photos/001.png"
    keeper.finish("done")
    assert len(lines) == 1
    assert "a photo was not kept: the system allows no further process or thread" in lines[0]
