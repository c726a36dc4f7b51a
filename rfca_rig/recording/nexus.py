"""NeXus attributes that let viewers find something to plot: a chain of defaults that ends at a signal and its axis."""

from collections.abc import Sequence

import h5py

from rfca_rig.recording.columns import link_name

# The column that viewers plot first.
PLOTTED = "fz_N"


def mark_root(file: h5py.Group, default: str) -> None:
    """`default` names the entry that is shown first."""
    file.attrs["NX_class"], file.attrs["default"] = "NXroot", default


def mark_entry(group: h5py.Group) -> None:
    """A group of numbered stages, of which the first is shown."""
    group.attrs["NX_class"], group.attrs["default"] = "NXentry", "001"


def mark_stage(group: h5py.Group, streams: Sequence[str]) -> None:
    """A group of streams; the force is shown where there is one."""
    group.attrs["NX_class"] = "NXsubentry"
    if streams:
        group.attrs["default"] = link_name("force" if "force" in streams else streams[0])


def mark_stream(group: h5py.Group, columns: Sequence[str], time: str) -> None:
    """Columns over a time; the vertical force is shown where there is one."""
    group.attrs["NX_class"] = "NXdata"
    if columns:
        group.attrs["signal"], group.attrs["axes"] = link_name(PLOTTED if PLOTTED in columns else columns[0]), time
