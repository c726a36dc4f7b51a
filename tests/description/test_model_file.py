"""Model files: written and read back, with effects, and what is wrong in them told with file and
line.
"""

import pytest

from rfca_rig.description.model_file import FoundEffect, nominal_model, read_model_file, write_model
from rfca_rig.errors import BadInput
from tests.report.recordings import BELIEVED

PLAY = {"id": "hinge_backlash", "parameters": {"half_gap_deg": 0.7}}
LOOP = FoundEffect(
    "spring_hysteresis",
    {"strength_relative": 0.2, "saturation_deg": 4.0},
    {"strength_relative": 0.01234},
)


def written(folder, sections=BELIEVED, found=(), comments=()):
    write_model(
        folder / "model.toml", sections, {"height_mm": 0.2, "k0_relative": None}, comments, found
    )
    return folder / "model.toml"


def test_a_model_comes_back_as_it_was_written(tmp_path):
    read = read_model_file(written(tmp_path))
    assert read.model() == nominal_model(BELIEVED)
    assert nominal_model(read.nominal()) == read.model()
    assert "effects" not in read.nominal() and "known_to" not in read.nominal()
    assert read.known_to.model_dump(exclude_none=True) == {"height_mm": 0.2}


def test_effects_believed_before_and_found_now_act_in_that_order_with_their_errors_beside_them(
    tmp_path,
):
    path = written(tmp_path, {**BELIEVED, "effects": [PLAY]}, [LOOP], ["diagnosed from\nruns/a"])
    read = read_model_file(path)
    assert [(effect.id, dict(effect.values)) for effect in read.model().effects] == [
        ("hinge_backlash", {"half_gap_deg": 0.7}),
        ("spring_hysteresis", {"strength_relative": 0.2, "saturation_deg": 4.0}),
    ]
    assert nominal_model(read.nominal()) == read.model()
    assert "# strength_relative is known to 0.0123\n" in path.read_text()
    assert path.read_text().startswith("# diagnosed from runs/a\n")


def test_an_effect_that_cannot_be_is_told_with_file_and_line(tmp_path):
    path = written(tmp_path, found=[FoundEffect("hinge_backlash", {"half_gap_deg": -1.0})])
    line = path.read_text().splitlines().index("[[effects]]") + 1
    with pytest.raises(
        BadInput,
        match=(
            rf"model\.toml:{line}: effects\[1\]: effect hinge_backlash: half_gap_deg = -1 must "
            r"be 0 or more"
        ),
    ):
        read_model_file(path)
