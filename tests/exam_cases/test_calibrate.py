"""The calibration of stated probabilities, on made-up statements and on a small folder."""

import json

import numpy as np
import pytest

from rfca_rig.diagnosis.decision import calibration
from rfca_rig.diagnosis.decision.calibration import FEATURES, calibration_of, features_in
from rfca_rig.errors import BadInput
from rfca_rig.exam.calibrate import Labelled, cross_validate, fit_weights, main, read_labelled
from rfca_rig.exam.claims import calibration_error
from rfca_rig.exam.examine import DIAGNOSES
from rfca_rig.exam.sealing import ExamPlan, begin, seal_all
from tests.exam_cases.test_score import truth

VALUES = {feature.name: 0.5 * (feature.low + feature.high) for feature in FEATURES}


def labelled(slope, n=400):
    """Statements whose truth depends on the first feature alone, with this slope of the logit per unit of its range."""
    random = np.random.default_rng(5)
    low, high = (np.array([getattr(feature, end) for feature in FEATURES]) for end in ("low", "high"))
    share = random.uniform(size=(n, len(FEATURES)))
    true = random.uniform(size=n) < 1.0 / (1.0 + np.exp(-slope * (share[:, 0] - 0.5)))
    return Labelled(low + share * (high - low), true, np.array([f"case-{i // 2}" for i in range(n)]))


def test_the_weight_of_what_matters_is_found_and_no_weight_has_the_wrong_sign():
    _, weights = fit_weights(labelled(8.0))
    assert FEATURES[0].sign == 1
    span = FEATURES[0].high - FEATURES[0].low
    assert 5.0 < weights[0] * span < 9.0
    assert all(weight * feature.sign >= 0.0 for weight, feature in zip(weights, FEATURES, strict=True))
    _, against = fit_weights(labelled(-8.0))
    assert against[0] == 0.0  # what would speak the wrong way is left out


def test_cross_validated_probabilities_are_calibrated_and_better_than_none():
    data = labelled(8.0)
    probability = cross_validate(data)
    assert calibration_error(probability, data.true) < 0.06
    assert probability[data.true].mean() > probability[~data.true].mean() + 0.3


def test_statements_of_one_case_stay_together(monkeypatch):
    data, seen = labelled(8.0, 40), []

    def fit(kept):
        seen.append(set(kept.case))
        return 0.0, np.zeros(len(FEATURES))

    monkeypatch.setattr("rfca_rig.exam.calibrate.fit_weights", fit)
    cross_validate(data)
    every = set(data.case.tolist())
    assert all(len(every - kept) == 2 for kept in seen)  # ten folds of twenty cases, each left out whole


def test_calibration_error_of_boasting():
    sure = np.full(10, 0.95)
    assert calibration_error(sure, np.arange(10) < 5) == pytest.approx(0.45)


def folder_with(tmp_path, support):
    folder = tmp_path / "benchmark"
    begin(folder, ExamPlan(1, {"one effect": 1}))
    seal_all([truth("case-0001", effects={"hinge_backlash": {"half_gap_deg": 1.0}})], folder)
    answer = folder / DIAGNOSES / "case-0001"
    answer.mkdir(parents=True)
    (answer / "diagnosis.json").write_text(json.dumps({"support": support}))
    return folder


def test_statements_are_read_from_a_benchmark_and_labelled_by_its_truths(tmp_path):
    ids = [("effect", "hinge_backlash"), ("effect", "tip_mass"), ("family", "hinge_stiffness"), ("family", "leg_mass")]
    folder = folder_with(tmp_path, [{"kind": kind, "id": name, "values": VALUES} for kind, name in ids])
    effects, families = (read_labelled([folder], kind) for kind in ("effect", "family"))
    assert effects.true.tolist() == [True, False] and families.true.tolist() == [True, False]
    assert np.allclose(effects.features, features_in(VALUES))


def test_a_benchmark_without_support_is_refused(tmp_path):
    with pytest.raises(BadInput, match="no diagnosis with support"):
        read_labelled([folder_with(tmp_path, [])], "effect")


def test_the_command_writes_what_the_package_reads(tmp_path, monkeypatch, capsys):
    support = [{"kind": kind, "id": name, "values": VALUES} for kind, name in (("effect", "hinge_backlash"), ("family", "leg_mass"))]
    out = tmp_path / "calibration.json"
    monkeypatch.setattr("sys.argv", ["calibrate", str(folder_with(tmp_path, support)), "--out", str(out)])
    assert main() == 0 and "calibration_error" in capsys.readouterr().out
    content = json.loads(out.read_text())
    assert set(content["effect"]["weights"]) == {feature.name for feature in FEATURES}
    assert content["benchmarks"] == ["seed 1, 1 cases of the kind 'one effect', 1 of them diagnosed"]


def test_the_shipped_calibration_prefers_laws_that_hold():
    for kind in ("effect", "family"):
        found = calibration_of(kind)
        better = np.array([feature.high if feature.sign > 0 else feature.low for feature in FEATURES])
        worse = np.array([feature.low if feature.sign > 0 else feature.high for feature in FEATURES])
        assert found.intercept + found.weights @ better > 3.0
        assert found.intercept + found.weights @ worse < -3.0


def test_a_file_of_other_features_is_refused(monkeypatch):
    calibration_of.cache_clear()
    monkeypatch.setattr(calibration, "FEATURES", FEATURES[1:])
    with pytest.raises(ValueError, match="regenerate it"):
        calibration_of("effect")
    calibration_of.cache_clear()
