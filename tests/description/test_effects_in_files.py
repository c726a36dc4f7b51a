"""Effects written in a rig file reach the model, and a wrong one is one clear line."""

import re
from pathlib import Path

import pytest

from rfca_rig.analysis.prediction import predict_stroke
from rfca_rig.description.model_file import nominal_model
from rfca_rig.description.rig_file import read_rig
from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import catalogue

TWIN = (Path(__file__).parents[2] / "calibration" / "twin.toml").read_text()
STOP = '\n[[effects]]\nid = "tip_mass"\nparameters = { mass_g = 20.0 }\n'


def ripple(amplitude, cycles):
    values = f"amplitude_relative = {amplitude}, cycles_per_turn = {cycles}"
    return f'\n[[effects]]\nid = "motor_speed_ripple"\nparameters = {{ {values} }}\n'


def rig_with(tmp_path, text):
    path = tmp_path / "rig.toml"
    path.write_text(TWIN + text)
    return read_rig(path)


def test_an_effect_in_the_file_changes_the_prediction(tmp_path):
    plain = rig_with(tmp_path, "").model()
    loaded = rig_with(tmp_path, STOP).model()
    valleys = [
        predict_stroke(model, 0.215, 3.249, 200.0).summary()["valley_fz_N"]
        for model in (plain, loaded)
    ]
    assert abs(valleys[0] - valleys[1]) > 0.05


def test_what_is_believed_keeps_its_effects_on_the_way_through_a_recording(tmp_path):
    rig = rig_with(tmp_path, STOP)
    assert nominal_model(rig.nominal()) == rig.model()
    assert "effects" not in rig_with(tmp_path, "").nominal()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (STOP.replace("tip_mass", "tip_math"), "effect tip_math: not in the catalogue"),
        (STOP.replace("mass_g", "mass"), "effect tip_mass: takes mass_g, was given mass"),
        (STOP.replace("20.0", '"heavy"'), "mass_g"),
        (
            STOP.replace("parameters", "values"),
            "effect tip_mass: values belongs to a tabulated_law",
        ),
        (STOP.replace("parameters", "numbers"), "effect tip_mass: parameters missing"),
        (STOP.replace("20.0", "nan"), "finite number"),
        (STOP.replace("20.0", "-1.0"), "effect tip_mass: mass_g = -1 must be 0 or more"),
        (
            ripple(1.0, 8.0),
            "effect motor_speed_ripple: amplitude_relative = 1 must stay below 1 in magnitude",
        ),
        (ripple(0.1, 0.0), "effect motor_speed_ripple: cycles_per_turn = 0 must be above 0"),
        (ripple(0.1, -2.0), "effect motor_speed_ripple: cycles_per_turn = -2 must be above 0"),
    ],
)
def test_a_wrong_effect_is_one_clear_line(tmp_path, text, said):
    with pytest.raises(BadInput, match=said) as raised:
        rig_with(tmp_path, text).model()
    assert "\n" not in str(raised.value)
    line = (TWIN + text).splitlines().index("[[effects]]") + 1
    assert re.match(
        rf"{re.escape(str(tmp_path))}/rig\.toml:({line}|{line + 2}): effects\[1\]",
        str(raised.value),
    )


@pytest.mark.parametrize(
    "text", [STOP.replace("20.0", "400.0"), STOP.replace("20.0", "0.0"), ripple(0.9, 100.0)]
)
def test_an_implausible_value_that_can_be_is_taken(tmp_path, text):
    assert len(rig_with(tmp_path, text).model().effects) == 1


def test_what_is_plausible_can_be():
    for effect in catalogue().values():
        for parameter in effect.parameters:
            assert parameter.why_not(parameter.high) is None
            assert parameter.why_not(parameter.low) is None
            assert parameter.why_not(float("nan")) is not None
