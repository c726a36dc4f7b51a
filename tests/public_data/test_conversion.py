"""Converters give the recordings on which the published numbers rest."""

import re

import numpy as np
import pytest
from scipy.io import savemat

from rfca_rig.errors import BadInput
from rfca_rig.public_data import conversion
from rfca_rig.public_data.conversion import average_neighbours, convert_file
from rfca_rig.public_data.registry import read_registry
from rfca_rig.public_data.sources import sources_folder
from tests.public_data.excerpts import rebuild, write_workbook
from tests.public_recordings import find_recordings

FILES = [(group, file) for group in read_registry().groups.values() for file in group.files]


# A zero with a minus sign, as some of the recordings have it.
NEGATIVE_ZERO = re.compile(r"(?<=,)-0(?=[,\n])")


def name_of(value):
    return getattr(value, "name", "")


def read_expected(group, file):
    """The recording, with one way to write zero."""
    text = (find_recordings(group.name) / file.name).read_text(encoding="utf-8")
    return NEGATIVE_ZERO.sub("0", text)


@pytest.mark.parametrize(("group", "file"), FILES, ids=name_of)
def test_sources_become_the_recordings_byte_for_byte(group, file):
    """With the true source files, in RFCA_RIG_DATASETS_SOURCES."""
    expected = read_expected(group, file)
    paths = [sources_folder() / group.source.name_of(path) for path in file.sources]
    if not all(path.is_file() for path in paths):
        pytest.skip("RFCA_RIG_DATASETS_SOURCES does not have the source files")
    assert convert_file(group, file, paths) == expected


@pytest.mark.parametrize(("group", "file"), FILES, ids=name_of)
def test_excerpts_of_the_sources_become_the_recordings_byte_for_byte(group, file, tmp_path):
    expected = read_expected(group, file)
    paths = []
    for path in file.sources:
        paths.append(tmp_path / path)
        rebuild(path, paths[-1])
    assert convert_file(group, file, paths) == expected


def test_a_torque_is_averaged_over_its_neighbours():
    values = np.array([1.0, 3.0, 5.0, 9.0])
    averaged = average_neighbours(values, (1.0, 2.0, 1.0))
    assert averaged.tolist() == [1.5, 3.0, 5.5, 8.0]


def test_a_height_that_jumps_and_comes_back_is_left_out(tmp_path):
    streams = {
        "force": ["0\t0\t{n}", range(10, 15)],
        "position": ["0.1\t0.2", range(9, 14)],
        "torque": ["0.3\t0.4", range(10, 15)],
        "height": ["{height}", range(10, 15)],
    }
    paths = []
    for name, (values, indices) in streams.items():
        lines = []
        for n in indices:
            height = 0.2 if n == 11 else 0.17
            lines.append(f"{n}\t\t{values.format(n=n, height=height)}\n")
        paths.append(tmp_path / f"{name}.dat")
        paths[-1].write_text("".join(lines))
    table = conversion.convert_hop(paths)
    # Index 14 has no position.
    assert table["t_s"] == ["0.0", "0.002", "0.003"]
    assert table["Fz_N"] == ["10.0", "12.0", "13.0"]
    assert table["q_kfe_rad"] == ["0.2"] * 3


@pytest.mark.parametrize("offset_rad", [0.0, np.pi, -np.pi])
def test_links_of_a_pendulum_count_from_the_link_before_and_from_below(tmp_path, offset_rad):
    swing = np.array([0.01 * np.sin(np.arange(12)), 0.02 * np.sin(np.arange(12))])
    cells = np.empty((2, 1), dtype=object)
    for stretch in range(2):
        angles = (stretch + 1) * swing + offset_rad
        cells[stretch, 0] = np.vstack([angles, np.zeros((2, 12))])
    savemat(tmp_path / "double.mat", {"Y_id": cells[:1], "Y_vad": cells[1:]})
    table = conversion.convert_multiarm([tmp_path / "double.mat"], links=2, stretch=2)
    assert table["t"] == ["0.000000", "0.005000", "0.010000"]
    expected = [f"{2 * value:.6f}" for value in swing[0, ::5]]
    assert table["q1"] == expected
    assert table["q2"] == expected


def test_a_file_that_is_no_workbook_is_refused(tmp_path):
    (tmp_path / "balls.xls").write_bytes(b"\xd0\xcf\x11\xe0")
    with pytest.raises(BadInput, match="is no workbook"):
        conversion.convert_ball_drop([tmp_path / "balls.xls"], "Golf Ball", 1)


def test_a_sheet_that_is_missing_is_named(tmp_path):
    write_workbook(tmp_path / "balls.xls", {"Golf Ball": [["1", "0", "40", "0"]]})
    assert conversion.convert_ball_drop([tmp_path / "balls.xls"], "Golf Ball", 1) == {
        "t_s": ["0"],
        "height_m": ["40"],
    }
    with pytest.raises(BadInput, match="has no sheet 'Tennis Ball'"):
        conversion.convert_ball_drop([tmp_path / "balls.xls"], "Tennis Ball", 1)


def test_a_variable_that_is_missing_is_named(tmp_path):
    savemat(tmp_path / "link.mat", {"data_th11": np.zeros((3, 3))})
    with pytest.raises(BadInput, match="no variable data_Im1; there are data_th11"):
        conversion.convert_flexible_link([tmp_path / "link.mat"])


def test_every_recording_has_a_fingerprint_and_every_source_a_sha256():
    fingerprints = conversion.read_fingerprints()
    assert set(fingerprints) == {f"{group.name}/{file.name}" for group, file in FILES}
    for group, file in FILES:
        assert set(file.sources) <= set(group.source.sha256)
        assert group.converter in conversion.CONVERTERS
    used = {(group.source.repository, path) for group, file in FILES for path in file.sources}
    for source in read_registry().sources.values():
        assert re.fullmatch("[0-9a-f]{40}", source.commit)
        assert all(re.fullmatch("[0-9a-f]{64}", digest) for digest in source.sha256.values())
        assert {(source.repository, path) for path in source.sha256} <= used
