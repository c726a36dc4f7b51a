"""A run goes on only with the torque-rotation curve that it began with."""

from types import SimpleNamespace

import pytest

from rfca_rig.bench.resume import read_compatible_rig
from rfca_rig.description.rig_file import read_rig
from rfca_rig.errors import BadInput
from tests.description.test_torque_rotation import CSV, TWIN

CURVE = '[leg.torque_rotation]\ncurve = "measured.csv"\n\n[ground]'


@pytest.fixture
def rig(tmp_path):
    (tmp_path / "measured.csv").write_text(CSV, encoding="utf-8")
    plain = "".join(
        line
        for line in TWIN.splitlines(keepends=True)
        if not line.startswith(("hinge_torque_Nm", "k0_", "k2_"))
    )
    (tmp_path / "rig.toml").write_text(plain.replace("[ground]", CURVE, 1), encoding="utf-8")
    return tmp_path / "rig.toml"


def begun_with(rig, **more):
    header = SimpleNamespace(
        provenance={"rig_file": rig.read_text(encoding="utf-8"), **more},
        nominal=read_rig(rig).nominal(),
    )
    return SimpleNamespace(header=header, folder=rig.parent)


def test_a_curve_that_reads_otherwise_is_refused_by_its_key(rig):
    begun = begun_with(rig)
    assert read_compatible_rig(begun, rig, deliberately=False).changes == {}
    (rig.parent / "measured.csv").write_text(CSV.replace("1.67", "1.70"), encoding="utf-8")
    with pytest.raises(
        BadInput,
        match=r"leg\.torque_rotation\.curve is not as the run began with; one run has one belief",
    ):
        read_compatible_rig(begun, rig, deliberately=True)


def test_a_run_with_a_model_file_does_not_ask_for_the_curve(rig):
    begun = begun_with(rig, model_file="the values of another file")
    (rig.parent / "measured.csv").write_text(CSV.replace("1.67", "1.70"), encoding="utf-8")
    assert read_compatible_rig(begun, rig, deliberately=False).changes == {}
