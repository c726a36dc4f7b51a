"""Samples of stages that are no strokes, as HDF5 groups of streams like those of a stroke."""

from collections.abc import Sequence

import h5py

from rfca_rig.recording import nexus
from rfca_rig.recording.model import RawStage, Source
from rfca_rig.recording.strokes import height_mm, read_height_mm, read_streams, write_streams

GROUP = "raw"


def write_raw_stages(parent: h5py.Group, stages: Sequence[RawStage], source: Source) -> None:
    """raw/001, raw/002 ... in the order given; no group where there are none."""
    if not stages:
        return
    parent = make_raw_stages(parent)
    for number, stage in enumerate(stages, start=1):
        group = parent.create_group(f"{number:03d}")
        mark_raw_stage(group, stage.label, stage.height_m, stage.cut_short)
        write_streams(group, stage.streams, source)


def make_raw_stages(parent: h5py.Group) -> h5py.Group:
    """The group of all of them, still without any."""
    group = parent.create_group(GROUP)
    nexus.mark_entry(group)
    return group


def mark_raw_stage(group: h5py.Group, label: str, height_m: float, cut_short: str) -> None:
    """What the stage was, as attributes."""
    group.attrs["label"] = label
    group.attrs["height_mm"] = height_mm(height_m)
    group.attrs["cut_short"] = cut_short


def read_raw_stages(parent: h5py.Group, source: Source) -> tuple[RawStage, ...]:
    """The stages in their order; () where there are none."""
    if GROUP not in parent:
        return ()
    group = parent[GROUP]
    return tuple(_read(group[number], source) for number in sorted(group, key=int))


def _read(group: h5py.Group, source: Source) -> RawStage:
    attributes = group.attrs
    return RawStage(str(attributes["label"]), read_height_mm(group) / 1e3, read_streams(group, source), str(attributes["cut_short"]))
