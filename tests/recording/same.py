"""When two recordings are the same: every number to the last bit, every name, every order."""

import numpy as np

from rfca_rig.recording.form import Recording, Stream


def assert_same(one: Recording, other: Recording) -> None:
    for name in ("title", "source", "believed", "known_to", "provenance"):
        assert getattr(one, name) == getattr(other, name), name
    assert repr(one.static) == repr(other.static)
    assert len(one.strokes) == len(other.strokes)
    for mine, its in zip(one.strokes, other.strokes, strict=True):
        assert (mine.height_m, mine.speed_rad_s, mine.repeat) == (its.height_m, its.speed_rad_s, its.repeat)
        assert list(mine.streams) == list(its.streams)
        for name in mine.streams:
            _assert_same_stream(mine.streams[name], its.streams[name])


def _assert_same_stream(one: Stream, other: Stream) -> None:
    np.testing.assert_array_equal(one.t_s, other.t_s)
    assert list(one.columns) == list(other.columns)
    for name, column in one.columns.items():
        its = other.columns[name]
        assert (column.unit, column.conversion, column.offset, column.raw.dtype) == (its.unit, its.conversion, its.offset, its.raw.dtype)
        np.testing.assert_array_equal(column.raw, its.raw)
