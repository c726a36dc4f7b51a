"""The labels of the statements that the benchmark of mechanisms hands to the calibration."""

import json

from rfca_rig.exam.calibrate import label, read_statements
from tests.benchmarks.mechanisms import label_statements
from tests.exam_cases.test_calibrate import VALUES


def test_statements_are_labelled_by_what_was_concealed(tmp_path):
    support = [
        {"kind": "effect", "id": "joint_damping", "values": VALUES, "cannot_tell_from": ()},
        {
            "kind": "effect",
            "id": "joint_drag",
            "values": VALUES,
            "cannot_tell_from": ("joint_damping",),
        },
        {"kind": "effect", "id": "joint_spring", "values": VALUES, "cannot_tell_from": ()},
        {"kind": "family", "id": "joint_dissipation", "values": VALUES, "cannot_tell_from": ()},
        {"kind": "family", "id": "body_mass", "values": VALUES, "cannot_tell_from": ()},
    ]
    answers = [{"kind": "damping", "support": support}, {"kind": "nothing", "support": support}]
    path = tmp_path / "arm.json"
    path.write_text(json.dumps(label_statements("arm", 3, answers)))
    words, statements = read_statements(path)
    assert words == "arm, seed 3, 2 cases"
    assert label(statements, "effect").true.tolist() == [True, True, False, False, False, False]
    assert label(statements, "family").true.tolist() == [True, False, False, False]
    assert set(label(statements, "family").rig) == {"arm"}
