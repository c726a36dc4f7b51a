"""Photos handed over are on disk, bit by bit, when the store is finished; a disk that refuses is told per photo."""

import cv2
import numpy as np

from rfca_rig.errors import RigError
from rfca_rig.recording import photo_store
from rfca_rig.recording.photo_store import PhotoStore

PICTURES = [np.random.default_rng(seed).integers(0, 255, (40, 60, 3), dtype=np.uint8) for seed in range(3)]


def test_every_picture_is_there_as_it_was(tmp_path):
    store = PhotoStore(tmp_path)
    names = [store.keep(picture) for picture in PICTURES]
    assert store.finish() == {}
    assert names == ["photos/001.png", "photos/002.png", "photos/003.png"]
    for name, picture in zip(names, PICTURES, strict=True):
        assert np.array_equal(cv2.imread(str(tmp_path / name)), picture)
    assert sorted(file.name for file in (tmp_path / "photos").iterdir()) == ["001.png", "002.png", "003.png"]


def test_a_run_without_photos_has_no_folder_of_them(tmp_path):
    assert PhotoStore(tmp_path).finish() == {}
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_refuses_one_keeps_the_others(tmp_path, monkeypatch):
    write = photo_store.write_atomically

    def refuse_the_second(path, content):
        if path.name == "002.png":
            raise RigError(f"{path}: cannot be written: no space left")
        write(path, content)

    monkeypatch.setattr(photo_store, "write_atomically", refuse_the_second)
    store = PhotoStore(tmp_path)
    for picture in PICTURES:
        store.keep(picture)
    faults = store.finish()
    assert list(faults) == ["photos/002.png"]
    assert "no space left" in faults["photos/002.png"]
    assert sorted(file.name for file in (tmp_path / "photos").iterdir()) == ["001.png", "003.png"]
