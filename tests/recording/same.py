"""When two recordings are the same: every number to the last bit, every name, every order."""

from collections.abc import Mapping

import numpy as np

from rfca_rig.recording.model import Recording, Stream


def assert_same(one: Recording, other: Recording) -> None:
    for name in ("title", "source", "nominal", "known_to", "provenance"):
        assert getattr(one, name) == getattr(other, name), name
    assert repr(one.static) == repr(other.static)
    assert [(raw.label, raw.height_m, raw.cut_short) for raw in one.raw] == [
        (raw.label, raw.height_m, raw.cut_short) for raw in other.raw
    ]
    for mine, its in zip(one.raw, other.raw, strict=True):
        _assert_same_streams(mine.streams, its.streams)
    assert len(one.strokes) == len(other.strokes)
    for mine, its in zip(one.strokes, other.strokes, strict=True):
        assert (mine.height_m, mine.speed_rad_s, mine.repeat) == (
            its.height_m,
            its.speed_rad_s,
            its.repeat,
        )
        _assert_same_streams(mine.streams, its.streams)


def _assert_same_streams(one: Mapping[str, Stream], other: Mapping[str, Stream]) -> None:
    assert list(one) == list(other)
    for name in one:
        _assert_same_stream(one[name], other[name])


def _assert_same_stream(one: Stream, other: Stream) -> None:
    np.testing.assert_array_equal(one.t_s, other.t_s)
    assert list(one.columns) == list(other.columns)
    for name, column in one.columns.items():
        its = other.columns[name]
        assert (column.unit, column.data.dtype) == (its.unit, its.data.dtype)
        np.testing.assert_array_equal(column.data, its.data)
