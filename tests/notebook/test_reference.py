"""A reference in a notebook: `rr.diagnose(new, reference=old)`."""

import pytest

import rfca_rig as rr
from rfca_rig.errors import BadInput
from tests.mechanism import servo as servos


def test_a_reference_that_is_the_recordings_themselves_is_refused(tmp_path):
    servo = servos.Servo()
    recording = servos.record(servo, "sines", 1.0, 1)
    known_to = {"mass_relative": 0.01}
    servos.write_campaign(tmp_path / "today", servos.mjcf(servo), [recording], known_to)
    with pytest.raises(BadInput, match="is among the recordings themselves"):
        rr.diagnose(tmp_path / "today", reference=tmp_path / "today", progress=False)
