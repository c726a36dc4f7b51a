"""How a run ended, in codes that do not change when the words do."""

import pytest

from rfca_rig.bench.provenance import Outcome
from rfca_rig.errors import DeviceError, DiskFull, RigError, Stopped, Trip, Tripped


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (None, ("done", 0, "done")),
        (Tripped(Trip.FOLLOWING, "behind"), ("TRIP F-02: behind", 3, "F-02")),
        (Stopped("enough"), ("enough", 130, "stopped")),
        (DiskFull("no room"), ("no room", 1, "disk-full")),
        (DeviceError("silent"), ("silent", 1, "device-error")),
        (RigError("gone"), ("gone", 1, "rig-error")),
    ],
)
def test_every_end_has_words_a_status_and_a_code(error, expected):
    outcome = Outcome.of(error)
    assert (outcome.why, outcome.exit_status, outcome.reason) == expected
