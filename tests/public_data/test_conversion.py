"""Converters give the recordings on which the published numbers rest."""

import re

import pytest

from rfca_rig.public_data.conversion import convert_file
from rfca_rig.public_data.registry import read_registry
from rfca_rig.public_data.sources import sources_folder
from tests.public_data.excerpts import rebuild
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
