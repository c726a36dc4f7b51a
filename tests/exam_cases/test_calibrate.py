"""The calibration of stated probabilities, on made-up statements and on a small folder."""

import json

import numpy as np
import pytest

from rfca_rig.diagnosis.decision import calibration
from rfca_rig.diagnosis.decision.calibration import FEATURES, calibration_of, features_in
from rfca_rig.errors import BadInput
from rfca_rig.exam.calibrate import Labelled, calibrate, fit_weights, label, main, read_statements
from rfca_rig.exam.claims import calibration_error
from rfca_rig.exam.examine import DIAGNOSES
from rfca_rig.exam.sealing import ExamPlan, begin, seal_all
from tests.exam_cases.test_score import truth

VALUES = {feature.name: 0.5 * (feature.low + feature.high) for feature in FEATURES}


def labelled(slope, n=400):
    """Statements whose truth depends on the first feature alone, with this slope of the logit
    per unit of its range.
    """
    random = np.random.default_rng(5)
    low, high = (
        np.array([getattr(feature, end) for feature in FEATURES]) for end in ("low", "high")
    )
    share = random.uniform(size=(n, len(FEATURES)))
    true = random.uniform(size=n) < 1.0 / (1.0 + np.exp(-slope * (share[:, 0] - 0.5)))
    return Labelled(
        low + share * (high - low),
        true,
        np.array([f"case-{i // 2}" for i in range(n)]),
        np.full(n, "leg"),
    )


def test_the_weight_of_what_matters_is_found_and_no_weight_has_the_wrong_sign():
    _, weights = fit_weights(labelled(8.0))
    assert FEATURES[0].sign == 1
    span = FEATURES[0].high - FEATURES[0].low
    assert 5.0 < weights[0] * span < 9.0
    assert all(
        weight * feature.sign >= 0.0 for weight, feature in zip(weights, FEATURES, strict=True)
    )
    _, against = fit_weights(labelled(-8.0))
    assert against[0] == 0.0  # what would speak the wrong way is left out


def test_calibration_error_of_boasting():
    sure = np.full(10, 0.95)
    assert calibration_error(sure, np.arange(10) < 5) == pytest.approx(0.45)


def folder_with(tmp_path, *supports):
    """A finished benchmark with a case of hinge backlash for each support."""
    folder = tmp_path / "benchmark"
    names = [f"case-{number:04d}" for number in range(1, 1 + len(supports))]
    begin(folder, ExamPlan(1, {"one effect": len(supports)}))
    seal_all(
        [truth(name, effects={"hinge_backlash": {"half_gap_deg": 1.0}}) for name in names], folder
    )
    for name, support in zip(names, supports, strict=True):
        answer = folder / DIAGNOSES / name
        answer.mkdir(parents=True)
        (answer / "diagnosis.json").write_text(json.dumps({"support": support}))
    return folder


def support_of(*ids):
    return [{"kind": kind, "id": name, "values": VALUES} for kind, name in ids]


def statements_file(path, rig, labels):
    """A file of statements with an effect and a family in each case."""
    statements = [
        {"case": f"{number:03d}", "rig": rig, "kind": kind, "values": VALUES, "true": true}
        for number, true in enumerate(labels)
        for kind in ("effect", "family")
    ]
    path.write_text(
        json.dumps({"format": "rfca-statements/1", "words": "made up", "statements": statements})
    )
    return path


BOTH = support_of(("effect", "hinge_backlash"), ("family", "hinge_stiffness"))


def test_statements_are_read_from_a_benchmark_and_labelled_by_its_truths(tmp_path):
    ids = [
        ("effect", "hinge_backlash"),
        ("effect", "tip_mass"),
        ("family", "hinge_stiffness"),
        ("family", "leg_mass"),
    ]
    _, statements = read_statements(folder_with(tmp_path, support_of(*ids)))
    effects, families = (label(statements, kind) for kind in ("effect", "family"))
    assert effects.true.tolist() == [True, False] and families.true.tolist() == [True, False]
    assert effects.rig.tolist() == ["leg", "leg"]
    assert np.allclose(effects.features, features_in(VALUES))


def test_a_benchmark_without_support_is_refused(tmp_path):
    with pytest.raises(BadInput, match="no diagnosis with support"):
        calibrate([folder_with(tmp_path, [], [])])


def test_a_fit_that_nothing_could_judge_is_refused(tmp_path):
    with pytest.raises(BadInput, match="one half of the cases"):
        calibrate([folder_with(tmp_path, BOTH)])


def test_a_fit_to_one_half_of_each_source_is_judged_on_the_other_half_by_rig(tmp_path):
    # The fitted half is true and the other half false, with the same values: the fit cannot have
    # seen it.
    arms = statements_file(tmp_path / "arms.json", "arm", [True, False] * 10)
    hoppers = statements_file(tmp_path / "hoppers.json", "hopper", [True, False] * 10)
    found = calibrate([arms, hoppers])
    assert found["benchmarks"] == ["made up", "made up"]
    for kind in ("effect", "family"):
        assert (found[kind]["statements"], found[kind]["true"]) == (40, 20)
        judged = found[kind]["other_half"]
        assert (judged["all"]["statements"], judged["all"]["true"]) == (20, 0)
        assert (judged["arm"]["statements"], judged["hopper"]["statements"]) == (10, 10)
        assert judged["arm"]["wrong_of_these"] == 10 and judged["arm"]["calibration_error"] > 0.9


@pytest.mark.parametrize(
    "content",
    [
        "{}",
        "[1]",
        '{"format": "rfca-statements/2"}',
        '{"format": "rfca-statements/1", "words": ""}',
        "no",
    ],
)
def test_a_file_that_holds_no_statements_is_named(tmp_path, content):
    path = tmp_path / "arms.json"
    path.write_text(content)
    with pytest.raises(BadInput, match=r"arms.json: .*rfca-statements/1"):
        read_statements(path)


def test_the_command_writes_what_the_package_reads(tmp_path, monkeypatch, capsys):
    out = tmp_path / "calibration.json"
    monkeypatch.setattr(
        "sys.argv", ["calibrate", str(folder_with(tmp_path, BOTH, BOTH)), "--out", str(out)]
    )
    assert main() == 0 and "calibration_error" in capsys.readouterr().out
    content = json.loads(out.read_text())
    assert set(content["effect"]["weights"]) == {feature.name for feature in FEATURES}
    assert content["benchmarks"] == [
        "seed 1, 2 cases of the kind 'one effect', 2 of them diagnosed"
    ]


def test_the_shipped_calibration_prefers_laws_that_hold():
    for kind in ("effect", "family"):
        found = calibration_of(kind)
        better = np.array(
            [feature.high if feature.sign > 0 else feature.low for feature in FEATURES]
        )
        worse = np.array(
            [feature.low if feature.sign > 0 else feature.high for feature in FEATURES]
        )
        assert found.intercept + found.weights @ better > 3.0
        assert found.intercept + found.weights @ worse < -3.0


def test_a_file_of_other_features_is_refused(monkeypatch):
    calibration_of.cache_clear()
    monkeypatch.setattr(calibration, "FEATURES", FEATURES[1:])
    with pytest.raises(ValueError, match="regenerate it"):
        calibration_of("effect")
    calibration_of.cache_clear()
