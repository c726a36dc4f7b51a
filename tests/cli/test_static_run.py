"""rfca-rig static run as a person types it: from the plan's check to a run folder with photos,
angles and overlays.
"""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from rfca_rig.recording.run_folder import read_stages
from rfca_rig.recording.store import read_recording
from tests.cli.typed import typed, typed_in

ROOT = Path(__file__).parents[2]
PROTOCOL = (ROOT / "protocols" / "static-angle.toml").read_text()
HEAD = (
    PROTOCOL.partition("[[stages]]")[0]
    .replace("[215.0, 235.0]", "[235.0]")
    .replace("move_speed_rad_s = 0.4", "move_speed_rad_s = 1.6")
)


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def protocol(folder, *stages, head=HEAD):
    """A protocol file with these stages: an angle, or an angle and a direction."""
    lines = [
        f'[[stages]]\nangle_deg = {angle}\ndirection = "{direction}"\n'
        for angle, direction in stages
    ]
    (folder / "stages.toml").write_text(head + "\n".join(lines))
    return folder / "stages.toml"


@pytest.fixture(scope="module")
def of_two(tmp_path_factory):
    """A whole run of two stages with photos, made once: where it ran, and what it answered."""
    folder = tmp_path_factory.mktemp("two")
    path = protocol(folder, (75.0, "loading"), (90.0, "loading"))
    said = typed_in(
        folder,
        "static",
        "run",
        "--protocol",
        path,
        "--rig",
        ROOT / "calibration" / "twin.toml",
        "--json",
    )
    assert said.exit_code == 0, said.err
    return folder, said.out


@pytest.fixture
def two_stages(of_two, here):
    """A copy of that run: its folder, and the answer."""
    shutil.copytree(of_two[0] / "runs", here / "runs")
    answer = json.loads(of_two[1])
    return here / answer["run"], answer


def static_run(here, monkeypatch, capsys, *stages, head=HEAD, words=()):
    return typed(
        monkeypatch,
        capsys,
        "static",
        "run",
        "--protocol",
        protocol(here, *stages, head=head),
        *words,
    )


@pytest.mark.long
def test_stages_have_hinge_angles_photos_and_overlays_and_everybody_can_read_the_run(
    here, monkeypatch, capsys, two_stages
):
    folder, answer = two_stages
    kept = read_recording(folder / "run.h5")
    for row, stage in zip(answer["stages"], kept.static, strict=True):
        assert row["hinge_deg"] == list(stage.hinge_deg)
        assert row["hinge_std_deg"] == list(stage.hinge_std_deg)
        assert (row["photo"], row["overlay"]) == (stage.photo, stage.overlay)
        assert (
            cv2.imread(str(folder / stage.photo)).shape
            == cv2.imread(str(folder / stage.overlay)).shape
            == (1000, 1600, 3)
        )
        # The twin's marks are exact; the deviations allow for gluing to 0.1 mm.
        assert max(stage.hinge_std_deg) < 0.4
        assert max(stage.hinge_reading_std_deg) < 0.2
        assert list(stage.hinge_deg) == sorted(stage.hinge_deg)  # bent back, most next to the shaft
    assert np.array([stage.hinge_deg for stage in kept.static])[:, 0] == pytest.approx(
        [-8.7, -13.3], abs=0.4
    )
    assert (kept.provenance["camera"], kept.provenance["seed"]) == ("twin", "1")
    assert "photos/002.png" in kept.provenance["photos_sha256"]
    assert kept.provenance["camera_file"] == (ROOT / "calibration" / "twin-camera.toml").read_text()
    for words in (
        ("report", folder, "--out", "report"),
        ("diagnose", folder, "--out", "diagnosis"),
    ):
        assert typed(monkeypatch, capsys, *words).exit_code == 0
    assert (
        f"{kept.static[0].hinge_deg[0]:.2f}".replace("-", "\u2212")
        in (here / "report" / "report.html").read_text()
    )


@pytest.mark.long
def test_the_bending_protocol_runs_and_its_report_finds_the_bend_and_the_hinges(
    here, monkeypatch, capsys
):
    answer = json.loads(
        typed(monkeypatch, capsys, "static", "run", "--protocol", "bending", "--json").out
    )
    # The plate reflects some marks; the reflections are reported and not taken for marks.
    assert all(
        stage["settled"] and "left out" not in stage["photo_doubts"] for stage in answer["stages"]
    )
    said = typed(monkeypatch, capsys, "static", "report", answer["run"], "--out", "bending")
    assert said.exit_code == 0
    assert "The leg was bent most at 185 mm, stage 8: by 138." in said.err
    found = json.loads((here / "bending" / "static.json").read_text())
    assert found["most_bent"]["bend_deg"] == pytest.approx(
        138.8, abs=0.3
    )  # the model's own at 155 degrees
    assert found["range_deg"][1] > 27.0
    for name, true in (("k0_Nm_per_rad", 10.98), ("k2_per_rad2", 4.56)):
        low, high = found[name]["interval_95"]
        assert low < true < high


@pytest.mark.long
def test_the_same_seed_gives_the_same_bytes_and_another_one_other_photos(here, monkeypatch, capsys):
    for seed in (3, 3, 4):
        assert (
            static_run(
                here, monkeypatch, capsys, (60.0, "loading"), words=("--seed", seed)
            ).exit_code
            == 0
        )
    runs = sorted((here / "runs").iterdir())
    for name in ("run.h5", "photos/001.png", "overlays/001.jpg"):
        first, again, other = ((run / name).read_bytes() for run in runs)
        assert first == again
        assert first != other


@pytest.mark.slow
def test_what_is_said_of_each_photo(here, monkeypatch, capsys):
    said = static_run(here, monkeypatch, capsys, (75.0, "loading"))
    (line,) = [line for line in said.err.splitlines() if line.startswith("SIM photos/")]
    assert line.startswith("SIM photos/001.png, stage 1 at 235 mm: hinges -8.")
    assert line.count("+-0.") == 6
    assert "SIM motor off; reading 1 photos ..." in said.err
    assert said.err.rstrip().endswith(
        "next: rfca-rig static report runs/SIM-static-stages-of-the-shaft-angle-001"
    )


def without_camera(here):
    text = (ROOT / "calibration" / "twin.toml").read_text()
    (here / "blind.toml").write_text(text.partition("[camera]")[0])
    return here / "blind.toml"


@pytest.mark.slow
def test_a_rig_without_a_camera_measures_forces_as_ever(here, monkeypatch, capsys):
    said = static_run(
        here, monkeypatch, capsys, (75.0, "loading"), words=("--rig", without_camera(here))
    )
    assert said.exit_code == 0
    (folder,) = (here / "runs").iterdir()
    assert not {"photos", "overlays"} & {file.name for file in folder.iterdir()}
    (stage,) = read_recording(folder / "run.h5").static
    assert np.isnan(stage.hinge_deg).all()
    assert (stage.photo, stage.photo_doubts, stage.settled) == ("", "", True)
    assert 0.1 < stage.held_s < 10.0


@pytest.mark.slow
def test_a_protocol_may_do_without_photos(here, monkeypatch, capsys):
    said = static_run(
        here,
        monkeypatch,
        capsys,
        (75.0, "loading"),
        head=HEAD.replace("photo = true", "photo = false"),
    )
    assert said.exit_code == 0
    (folder,) = (here / "runs").iterdir()
    assert not {"photos", "overlays"} & {file.name for file in folder.iterdir()}


def test_a_calibration_that_is_not_there_is_told_before_anything_moves(here, monkeypatch, capsys):
    (here / "rig.toml").write_text((ROOT / "calibration" / "twin.toml").read_text())
    said = static_run(
        here, monkeypatch, capsys, (75.0, "loading"), words=("--rig", here / "rig.toml")
    )
    assert said.exit_code == 2
    assert "twin-camera.toml: not there; [camera] of the rig file names it" in said.err
    assert not (here / "runs").exists()


@pytest.mark.slow
def test_an_interrupted_run_is_recovered_with_its_photos_read(monkeypatch, capsys, two_stages):
    folder, _ = two_stages
    whole = read_recording(folder / "run.h5")
    for name in ("run.h5", "end.json", "SHA256SUMS", "overlays/001.jpg"):
        (folder / name).unlink()
    assert np.isnan(read_stages(folder).static[0].hinge_deg).all()
    assert typed(monkeypatch, capsys, "recover", folder).exit_code == 0
    assert repr(read_recording(folder / "run.h5").static) == repr(whole.static)
    assert (folder / "overlays" / "001.jpg").is_file()


def test_a_leg_that_would_wedge_is_refused_with_stage_force_and_limit(here, monkeypatch, capsys):
    said = static_run(here, monkeypatch, capsys, (135.0, "loading"), (60.0, "unloading"))
    assert said.exit_code == 2
    assert (
        "hold 2 at 60.0 deg, 235 mm, unloading: the model expects 385 N and 8.5 N m, the "
        "rig's limits are 300 N"
    ) in said.err
    assert not (here / "runs").exists()


def test_a_leg_that_wedges_only_on_a_slightly_rougher_floor_is_refused_too(
    here, monkeypatch, capsys
):
    """At 215 mm the nominal friction of 0.41 lets the tip slide back; 0.51 does not."""
    head = HEAD.replace("[235.0]", "[215.0]")
    said = static_run(here, monkeypatch, capsys, (135.0, "loading"), (60.0, "unloading"), head=head)
    assert said.exit_code == 2
    assert "hold 2 at 60.0 deg, 215 mm, unloading: the model expects 44" in said.err
    assert (
        "with a friction of 0.51, which is 2 standard deviations above the nominal one" in said.err
    )
    assert (
        static_run(
            here,
            monkeypatch,
            capsys,
            (135.0, "loading"),
            (133.0, "unloading"),
            head=head,
            words=("--dry-run",),
        ).exit_code
        == 0
    )


def test_reversals_are_stages_of_their_own(here, monkeypatch, capsys):
    head = HEAD.replace("# reversal_deg = 1.0 ", "reversal_deg = 1.0 ")
    said = static_run(
        here,
        monkeypatch,
        capsys,
        (75.0, "loading"),
        (90.0, "loading"),
        head=head,
        words=("--dry-run",),
    )
    assert said.exit_code == 0
    holds = [line.split(", model")[0] for line in said.err.splitlines() if "hold" in line]
    assert holds == [
        "SIM   hold 1 at 75.0 deg, 235 mm, loading",
        "SIM   hold 2 at 74.0 deg, 235 mm, unloading",
        "SIM   hold 3 at 90.0 deg, 235 mm, loading",
        "SIM   hold 4 at 89.0 deg, 235 mm, unloading",
    ]


CAMERA = ("--camera", ROOT / "calibration" / "twin-camera.toml")


@pytest.fixture
def run_and_card(here, two_stages):
    """A run, and its photos as a camera's card has them: JPEG under the camera's own names."""
    run, _ = two_stages
    (here / "card").mkdir()
    for name, number in (("001", "9"), ("002", "10")):
        picture = cv2.imread(str(run / "photos" / f"{name}.png"))
        cv2.imwrite(
            str(here / "card" / f"IMG_{number}.JPG"), picture, [cv2.IMWRITE_JPEG_QUALITY, 97]
        )
    return run, here / "card"


@pytest.mark.slow
def test_photos_taken_by_hand_are_read_afterwards(here, monkeypatch, capsys, run_and_card):
    run, card = run_and_card
    before = (run / "run.h5").read_bytes()
    assert typed(monkeypatch, capsys, "static", "photos", run, card, *CAMERA).exit_code == 0
    (new,) = set((here / "runs").iterdir()) - {run}
    assert (run / "run.h5").read_bytes() == before
    read = read_recording(new / "run.h5")
    earlier = read_recording(run / "run.h5")
    assert [stage.photo for stage in read.static] == ["photos/001.jpg", "photos/002.jpg"]
    assert (new / "photos" / "002.jpg").read_bytes() == (card / "IMG_10.JPG").read_bytes()
    angles, same = (np.array([stage.hinge_deg for stage in one.static]) for one in (read, earlier))
    assert 0.0 < np.abs(angles - same).max() < 0.1
    assert "photos/001.jpg" in read.provenance["photos_sha256"]
    assert read.provenance["photos_from"] == "card"


@pytest.mark.slow
def test_photos_in_the_wrong_order_give_no_angles_and_one_too_few_leaves_nothing(
    here, monkeypatch, capsys, run_and_card
):
    run, card = run_and_card
    (card / "IMG_9.JPG").rename(card / "IMG_11.JPG")
    said = typed(monkeypatch, capsys, "static", "photos", run, card, *CAMERA)
    assert said.exit_code == 0
    assert said.err.count("hinges ? ? ? ? ? ? deg; the photo shows the shaft at") == 2
    there = sorted((here / "runs").iterdir())
    (card / "IMG_11.JPG").unlink()
    said = typed(monkeypatch, capsys, "static", "photos", run, card, *CAMERA)
    assert said.exit_code == 2
    assert "1 photos for 2 static stages" in said.err
    assert sorted((here / "runs").iterdir()) == there


@pytest.mark.slow
def test_a_run_that_trips_keeps_its_stages_with_their_photos_read(here, monkeypatch, capsys):
    text = (
        (ROOT / "calibration" / "twin.toml")
        .read_text()
        .replace("torque_limit_Nm = 40.0", "torque_limit_Nm = 2.8")
    )
    camera = (ROOT / "calibration" / "twin-camera.toml").read_text()
    (here / "weak.toml").write_text(text)
    (here / "twin-camera.toml").write_text(camera)
    slowly = HEAD.replace(
        "move_speed_rad_s = 1.6", "move_speed_rad_s = 0.4"
    )  # so that the leg holds the shaft before it lags too far
    said = static_run(
        here,
        monkeypatch,
        capsys,
        (75.0, "loading"),
        (135.0, "loading"),
        head=slowly,
        words=("--rig", here / "weak.toml"),
    )
    assert said.exit_code == 3
    assert "TRIP F-03: the shaft has stood" in said.err.splitlines()[-1]
    (folder,) = (here / "runs").iterdir()
    kept = read_recording(folder / "run.h5")
    assert [stage.photo for stage in kept.static] == ["photos/001.png"]
    assert np.isfinite(kept.static[0].hinge_deg).all()
    assert "with 2.8 N m from the motor" in kept.provenance["ended"]


@pytest.mark.long
def test_another_calibration_reads_the_same_photos_of_the_twins_own_camera(
    two_stages, here, monkeypatch, capsys
):
    folder, answer = two_stages
    own = (ROOT / "calibration" / "twin-camera.toml").read_text()
    # Without its distortion the lens bends the leg.
    other = own.replace("distortion = [-0.09, 0.06,", "distortion = [0.0, 0.0,")
    assert other != own
    (here / "other.toml").write_text(other)
    said = static_run(
        here,
        monkeypatch,
        capsys,
        (75.0, "loading"),
        (90.0, "loading"),
        words=("--camera", "other.toml", "--json"),
    )
    assert said.exit_code == 0, said.err
    again = json.loads(said.out)
    photo = answer["stages"][0]["photo"]
    assert (here / again["run"] / photo).read_bytes() == (folder / photo).read_bytes()
    known = read_recording(here / again["run"] / "run.h5").provenance
    assert known["camera_file"] == other
    # Where a continuation finds it again.
    assert known["calibration_file"] == "other.toml"
    apart_deg = np.abs(
        np.subtract(again["stages"][0]["hinge_deg"], answer["stages"][0]["hinge_deg"])
    )
    assert 0.01 < apart_deg.max() < 1.0


def test_a_camera_for_a_rig_without_one_is_one_line(here, monkeypatch, capsys):
    text = (ROOT / "calibration" / "twin.toml").read_text()
    (here / "blind.toml").write_text(text[: text.index("\n[camera]")])
    (here / "other.toml").write_text((ROOT / "calibration" / "twin-camera.toml").read_text())
    said = static_run(
        here,
        monkeypatch,
        capsys,
        (75.0, "loading"),
        words=("--rig", "blind.toml", "--camera", "other.toml"),
    )
    assert said.exit_code == 2
    assert "--camera other.toml: blind.toml has no [camera]" in said.err
