"""The process that reads photos during a run: it gives the same marks, and its end costs none."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from rfca_rig.bench import photo_reader
from rfca_rig.bench.photo_reader import PhotoReader
from rfca_rig.errors import RigError
from rfca_rig.subprocesses import HelperWatch
from rfca_rig.vision.identify import IdentifiedMarks
from rfca_rig.vision.leg_photo import PhotoSetup, read_marks
from tests.vision.drawing import Look, draw
from tests.vision.scenes import LENGTHS_M, PLAN, camera, pose

EYE = PhotoSetup(camera(800), PLAN, tuple(LENGTHS_M.tolist()))


def photograph(path: Path, seed: int) -> None:
    """Like the recorder, it gives the photo its name when it is complete."""
    random = np.random.default_rng(seed)
    begun = path.with_name(f"begun-{path.name}")
    cv2.imwrite(str(begun), draw(pose(random), LENGTHS_M, PLAN, EYE.camera, Look(), random))
    begun.rename(path)


def places(marks: IdentifiedMarks) -> list[list[float] | None]:
    return [
        None if mark is None else [*mark.px.tolist(), *mark.std_px.tolist()] for mark in marks.marks
    ]


def test_photos_that_come_before_or_after_they_are_announced_are_read_as_in_this_process(
    tmp_path: Path,
) -> None:
    photograph(tmp_path / "1.png", 1)
    with PhotoReader(tmp_path, EYE) as reader:
        reader.expect("1.png")
        reader.expect("2.png")
        photograph(tmp_path / "2.png", 2)
        found = reader.collect()
    assert list(found) == ["1.png", "2.png"]
    for name, marks in found.items():
        assert marks.is_complete
        assert places(marks) == places(read_marks(cv2.imread(str(tmp_path / name)), EYE))


def test_broken_and_lost_photos_are_left_to_the_caller(tmp_path: Path) -> None:
    (tmp_path / "1.png").write_bytes(b"no picture")
    photograph(tmp_path / "3.png", 3)
    with PhotoReader(tmp_path, EYE) as reader:
        for name in ("1.png", "2.png", "3.png"):
            reader.expect(name)
        assert list(reader.collect()) == ["3.png"]


@pytest.mark.parametrize("module", ["rfca_rig.no_such_module", "rfca_rig.errors"])
def test_a_reader_that_ends_by_itself_leaves_all_photos_to_the_caller(
    module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(photo_reader, "MODULE", module)
    with PhotoReader(tmp_path, EYE) as reader:
        reader.expect("1.png")
        assert not reader.collect()


def test_a_reader_that_is_killed_is_noticed_at_the_next_look(tmp_path: Path) -> None:
    helpers = HelperWatch()
    with PhotoReader(tmp_path, EYE) as reader:
        reader.watch(helpers)
        helpers.check()
        reader._process.kill()
        reader._process.wait()
        with pytest.raises(RigError, match="the process that reads the photos has ended by itself"):
            helpers.check()


def test_a_system_that_starts_no_process_leaves_all_photos_to_the_caller(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_module: str, _assignment: object) -> None:
        raise BlockingIOError

    monkeypatch.setattr(photo_reader.subprocesses, "spawn", refuse)
    with PhotoReader(tmp_path, EYE) as reader:
        reader.expect("1.png")
        assert not reader.collect()
