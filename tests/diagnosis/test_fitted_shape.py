"""The fitted shape of a law reaches model file and document, and no parameter of the contract."""

from dataclasses import replace

import pytest

from rfca_rig.description.model_file import read_model_file
from rfca_rig.diagnosis.decision.comparison import compare
from rfca_rig.diagnosis.decision.sizes import estimate_sizes
from rfca_rig.diagnosis.leg.model_files import _to_found_effect
from rfca_rig.diagnosis.result import NamedEffect, Value
from rfca_rig.diagnosis.result_builder import present_effects
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.reports.diagnosis.json_file import _effect
from tests.description.test_model_file import written
from tests.diagnosis.by_hand import RIG, flaps_of, found_among, present, recorded

TRUE = {"rise_relative": 0.5, "speed_m_s": 0.3, "exponent": 2.0}


@pytest.fixture(scope="module")
def found():
    rig = replace(RIG, effects=(present("ground_stribeck", **TRUE),))
    return found_among(
        flaps_of(recorded(rig, [(205.0, 2.0), (205.0, 4.0), (220.0, 3.0)], with_shaft=False)),
        ["ground_stribeck"],
    )


@pytest.mark.slow
def test_a_law_of_another_exponent_is_fitted_with_its_size_and_its_exponent(found):
    best = found.named[0]
    sizes, shape = estimate_sizes(compare(found), best, 0)
    assert set(sizes) == {"rise_relative", "speed_m_s"}
    exponent = shape["exponent"]
    assert abs(exponent.value - 2.0) < 3.0 * exponent.std
    assert exponent.std < 0.5
    (fitted,) = present_effects(best)
    assert dict(fitted.values)["exponent"] == pytest.approx(exponent.value)


def test_the_fitted_shape_is_in_the_model_file_and_under_its_own_key_in_the_document(tmp_path):
    effect = NamedEffect(
        "ground_stribeck",
        "",
        0.9,
        {"rise_relative": Value(0.5, 0.1), "speed_m_s": Value(0.3, 0.0)},
        (),
        "",
        {"exponent": Value(1.9, 0.2)},
    )
    path = written(tmp_path, found=[_to_found_effect(effect)])
    assert "exponent is known to 0.2" in path.read_text()
    values = {"rise_relative": 0.5, "speed_m_s": 0.3, "exponent": 1.9}
    assert read_model_file(path).model().effects[-1] == PresentEffect(
        "ground_stribeck", tuple(values.items())
    )
    assert set(_effect(effect)["parameters"]) == {"rise_relative", "speed_m_s"}
    assert _effect(effect)["shape"] == {"exponent": {"value": 1.9, "std": 0.2}}
