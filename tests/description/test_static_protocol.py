"""Static protocol files: what a stage and its reversal become."""

from pathlib import Path

import numpy as np
import pytest

from rfca_rig.description.protocol_file import read_static
from rfca_rig.errors import BadInput

HEAD = (
    (Path(__file__).parents[2] / "protocols" / "static-angle.toml")
    .read_text()
    .partition("[[stages]]")[0]
)


def read(folder, stages, head=HEAD):
    (folder / "p.toml").write_text(head + stages)
    return read_static(folder / "p.toml").static_stages()


def held_deg(stages):
    return [
        (pytest.approx(float(np.degrees(angle))), direction)
        for angle, direction in stages.angles_rad
    ]


def test_a_reversal_goes_against_the_stage_s_direction(tmp_path):
    entries = (
        "angle_deg = 90.0",
        'angle_deg = 88.0\ndirection = "unloading"',
        "angle_deg = 100.0\nreversal_deg = 0.0",
    )
    text = "".join(f"[[stages]]\n{entry}\n" for entry in entries)
    plain = read(tmp_path, text)
    assert held_deg(plain) == [(90.0, "loading"), (88.0, "unloading"), (100.0, "loading")]
    back = read(tmp_path, text, HEAD.replace("# reversal_deg = 1.0", "reversal_deg = 1.5"))
    assert held_deg(back) == [
        (90.0, "loading"),
        (88.5, "unloading"),
        (88.0, "unloading"),
        (89.5, "loading"),
        (100.0, "loading"),
    ]


def test_dwell_and_photo_are_as_the_file_says(tmp_path):
    stage = "[[stages]]\nangle_deg = 90.0\n"
    assert (read(tmp_path, stage).dwell_s, read(tmp_path, stage).photo) == (0.2, True)
    other = read(
        tmp_path,
        stage,
        HEAD.replace("dwell_s = 0.2", "dwell_s = 3.0").replace("photo = true", "photo = false"),
    )
    assert (other.dwell_s, other.photo) == (3.0, False)


def test_a_protocol_from_before_these_entries_reads_as_it_did(tmp_path):
    lines = [
        line
        for line in HEAD.splitlines()
        if not line.startswith(("dwell_s", "photo", "# reversal"))
    ]
    stages = read(tmp_path, "[[stages]]\nangle_deg = 90.0\n", "\n".join(lines) + "\n")
    assert (stages.dwell_s, stages.average_s, held_deg(stages)) == (0.0, 0.5, [(90.0, "loading")])


@pytest.mark.parametrize("entry", ["reversal_deg = -1.0", "reversal_deg = 25.0"])
def test_reversals_are_small_and_never_negative(tmp_path, entry):
    with pytest.raises(BadInput, match=r"p.toml:\d+: stages\[1\].reversal_deg: should be"):
        read(tmp_path, f"[[stages]]\nangle_deg = 90.0\n{entry}\n")
