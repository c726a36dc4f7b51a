"""Effects written in a rig file reach the model, and a wrong one is one clear line."""

from pathlib import Path

import pytest

from rfca_rig.analysis.prediction import predict_stroke
from rfca_rig.description.believed import believed_model
from rfca_rig.description.rig_file import read_rig
from rfca_rig.errors import BadInput

TWIN = (Path(__file__).parents[2] / "calibration" / "twin.toml").read_text()
STOP = '\n[[effects]]\nid = "tip_mass"\nparameters = { mass_g = 20.0 }\n'


def rig_with(tmp_path, text):
    path = tmp_path / "rig.toml"
    path.write_text(TWIN + text)
    return read_rig(path)


def test_an_effect_in_the_file_changes_the_prediction(tmp_path):
    plain, loaded = rig_with(tmp_path, "").model(), rig_with(tmp_path, STOP).model()
    valleys = [predict_stroke(model, 0.215, 3.249, 200.0).summary()["valley_fz_N"] for model in (plain, loaded)]
    assert abs(valleys[0] - valleys[1]) > 0.05


def test_what_is_believed_keeps_its_effects_on_the_way_through_a_recording(tmp_path):
    rig = rig_with(tmp_path, STOP)
    assert believed_model(rig.believed()) == rig.model()
    assert "effects" not in rig_with(tmp_path, "").believed()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (STOP.replace("tip_mass", "tip_math"), "effect tip_math: not in the catalogue"),
        (STOP.replace("mass_g", "mass"), "effect tip_mass: takes mass_g, was given mass"),
        (STOP.replace("20.0", '"heavy"'), "mass_g"),
        (STOP.replace("parameters", "values"), "unknown key"),
    ],
)
def test_a_wrong_effect_is_one_clear_line(tmp_path, text, said):
    with pytest.raises(BadInput, match=said) as raised:
        rig_with(tmp_path, text).model()
    assert "\n" not in str(raised.value)
