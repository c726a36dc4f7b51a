"""A run opens in other people's programs: h5py, and xarray with both of its engines; photos
aside, nothing else is needed.
"""

from pathlib import Path

import h5py
import numpy as np
import pytest

from rfca_rig.recording import run_folder
from rfca_rig.recording.layout import stage_files
from tests.recording.growing import PER_TICK, TICKS, grown, stroke

xarray = pytest.importorskip("xarray")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """run.h5, and a stage on its own."""
    folder = tmp_path_factory.mktemp("other") / "run"
    grown(folder, 2).finish("done")
    return {"run.h5": run_folder.build_recording(folder), "a stage": stage_files(folder)[0]}


@pytest.mark.parametrize("engine", ["h5netcdf", "netcdf4"])
@pytest.mark.parametrize("name", ["run.h5", "a stage"])
def test_xarray_finds_time_units_and_values(files: dict[str, Path], name: str, engine: str):
    pytest.importorskip({"netcdf4": "netCDF4"}.get(engine, engine))
    with xarray.open_dataset(files[name], group="strokes/001/force", engine=engine) as force:
        fz = force["fz_N"]
        expected = stroke(1).streams["force"]
        assert fz.dims == ("t_s",)
        np.testing.assert_array_equal(fz.values, expected.columns["fz_N"].values)
        np.testing.assert_array_equal(force["t_s"].values, expected.t_s)
        assert (fz.dtype, fz.attrs["units"]) == (np.float64, "N")
        assert len(fz) == TICKS * PER_TICK


@pytest.mark.parametrize("engine", ["h5netcdf", "netcdf4"])
def test_xarray_opens_the_whole_tree(files: dict[str, Path], engine: str):
    pytest.importorskip({"netcdf4": "netCDF4"}.get(engine, engine))
    anonymous = (
        {"phony_dims": "sort"} if engine == "h5netcdf" else {}
    )  # the static table has no axis
    with xarray.open_datatree(files["run.h5"], engine=engine, **anonymous) as tree:
        assert tree["strokes/001/shaft"]["shaft_angle_rad"].dims == ("t_s",)
        assert tree["raw/001/force"]["fz_N"].dims == ("t_s",)
        assert tree["static"]["fz_N"].values == pytest.approx([2.0])
        assert tree["strokes/001"].attrs["height_mm"] == 215.0


def test_h5py_reads_each_stage_alone(files: dict[str, Path]):
    with h5py.File(files["a stage"]) as file:
        assert file["strokes/001/force/fz_N"].dims[0][0] == file["strokes/001/force/t_s"]
        assert file.attrs["source"] == file["strokes/001/force"].attrs["source"] == "SIM"
        assert file.id.get_create_plist().get_version()[0] < 3, "older tools open it"


def test_viewers_of_nexus_files_find_something_to_plot(files: dict[str, Path]):
    """From the root along the defaults to a signal over its axis, as the NeXus manual describes
    it.
    """
    for path in files.values():
        with h5py.File(path) as file:
            group = file
            classes = []
            while "default" in group.attrs:
                classes.append(group.attrs["NX_class"])
                group = group[group.attrs["default"]]
            assert [*classes, group.attrs["NX_class"]] == [
                "NXroot",
                "NXentry",
                "NXsubentry",
                "NXdata",
            ]
            assert (group.attrs["signal"], group.attrs["axes"]) == ("fz_N", "t_s")
            assert (
                group[group.attrs["signal"]].shape
                == group[group.attrs["axes"]].shape
                == (TICKS * PER_TICK,)
            )
