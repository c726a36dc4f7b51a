"""rfca-rig setup zero as a person types it, and the runs before and after it."""

import json
import shutil
from math import degrees, radians

import numpy as np
import pytest
import typer

from rfca_rig.bench import zero_setup
from rfca_rig.bench.zero_check import read_check, state_file
from rfca_rig.bench.zero_setup import HeldMotor
from rfca_rig.cli.paths import PACKAGE, refuse_shipped
from rfca_rig.description.rig_file import read_rig
from rfca_rig.devices.checks import Colour
from rfca_rig.doctor.rig_checks import check_zero
from rfca_rig.errors import BadInput
from rfca_rig.recording.store import read_recording
from tests.bench.test_zero_check import HANGING_RAD, MAKES, MOTEUS, ODRIVE, Lab, lab, write_rig
from tests.cli.typed import typed
from tests.engine.rigs import ROOT

STROKE = ("dynamic", "run", "--height", "215", "--speed", "2.433", "--repeats", "1")
RESTART = ("--fault", "drive-restart@0")


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "calibration" / "twin-camera.toml", tmp_path)
    return tmp_path


def write_twin(folder, motor, policy):
    text = (ROOT / "calibration" / "twin.toml").read_text()
    head, _, rest = text.partition("[motor]")
    stated = f'zero_policy = "{policy}"\n' if policy else ""
    path = folder / "rig.toml"
    path.write_text(f"{head}[motor]{motor}{stated}\n{rest[rest.index('[force_sensor]') :]}")
    return path


def shaft_of(run):
    (stroke,) = read_recording(run / "run.h5").strokes
    return stroke.streams["shaft"].columns["shaft_angle_rad"].values


def test_a_power_cycle_between_two_runs_is_noticed_and_set_right(here, monkeypatch, capsys):
    rig = write_twin(here, ODRIVE, "behind-gear")
    first_zero = typed(monkeypatch, capsys, "setup", "zero", "--rig", rig, "--yes")
    assert first_zero.exit_code == 0, first_zero.err
    assert "as it was" in first_zero.out
    # A twin is parked anew for each run, so the second needs no other check.
    for _ in range(2):
        assert typed(monkeypatch, capsys, *STROKE, "--rig", rig).exit_code == 0
    refused = typed(monkeypatch, capsys, *STROKE, "--rig", rig, *RESTART)
    assert refused.exit_code == 2
    last = refused.err.strip().splitlines()[-1]
    assert "the drive's angles may be wrong" in last
    assert last.endswith(f"type rfca-rig setup zero --rig {rig}")
    assert len(list((here / "runs").iterdir())) == 2
    again = typed(monkeypatch, capsys, "setup", "zero", "--rig", rig, "--yes", *RESTART)
    assert again.exit_code == 0, again.err
    assert "zero_turns = 0.75: -2 motor turns, 80.0 deg of the shaft" in again.out
    assert "zero_turns = 0.75  # read on the first day\n" in rig.read_text()
    assert typed(monkeypatch, capsys, *STROKE, "--rig", rig).exit_code == 0
    first, _, second = sorted((here / "runs").iterdir())
    # The twin is the same; float32 of the wire rounds another reading otherwise.
    assert shaft_of(second) == pytest.approx(shaft_of(first), abs=radians(0.2))
    provenance = json.loads((second / "run.json").read_text())["provenance"]
    assert provenance["zero_policy"] == "behind-gear"
    assert provenance["zero_checked_at"] == read_check(rig).checked_at
    assert provenance["zero_evidence"] == "the encoder stands where it was left 0 s ago"


# The twin of a lab's own drive has no faults.
@pytest.mark.parametrize("make", [make for make in MAKES if make != "own"])
@pytest.mark.parametrize("policy", ["incremental", "behind-gear"])
def test_the_twin_of_each_make_is_refused_after_a_power_cycle(
    here, monkeypatch, capsys, make, policy
):
    rig = write_twin(here, MAKES[make], policy)
    assert typed(monkeypatch, capsys, "setup", "zero", "--rig", rig, "--yes").exit_code == 0
    refused = typed(monkeypatch, capsys, *STROKE, "--rig", rig, *RESTART)
    assert refused.exit_code == 2
    assert "type rfca-rig setup zero" in refused.err
    assert not (here / "runs").exists()


def test_without_a_check_no_rig_is_armed_and_a_dry_run_goes_on(here, monkeypatch, capsys):
    rig = write_rig(here, ODRIVE, "incremental")
    monkeypatch.setattr(typer, "prompt", lambda *_, **__: pytest.fail("asked to arm the rig"))
    refused = typed(monkeypatch, capsys, *STROKE, "--rig", rig)
    assert refused.exit_code == 2
    assert "its zero was never checked" in refused.err
    assert typed(monkeypatch, capsys, *STROKE, "--rig", rig, "--dry-run").exit_code == 0


def test_a_real_rig_without_a_policy_is_told_so_before_it_is_armed(here, monkeypatch, capsys):
    rig = write_rig(here, ODRIVE, None)
    monkeypatch.setattr(typer, "prompt", lambda *_, **__: "no")
    said = typed(monkeypatch, capsys, *STROKE, "--rig", rig)
    assert said.exit_code == 2
    assert "zero_policy is missing under [motor]" in said.out + said.err


def test_a_stopped_run_goes_on_only_with_a_zero_that_holds(here, monkeypatch, capsys):
    rig = write_twin(here, ODRIVE, "incremental")
    assert typed(monkeypatch, capsys, "setup", "zero", "--rig", rig, "--yes").exit_code == 0
    tripped = typed(
        monkeypatch, capsys, *STROKE[:-1], "2", "--rig", rig, "--fault", "encoder-jump@6"
    )
    assert tripped.exit_code == 3
    (run,) = (here / "runs").iterdir()
    resume = ("resume", run, "--after-trip")
    refused = typed(monkeypatch, capsys, *resume)
    assert refused.exit_code == 2
    assert "position leapt" in refused.err
    assert "rfca-rig setup zero" in refused.err
    assert typed(monkeypatch, capsys, "setup", "zero", "--rig", rig, "--yes").exit_code == 0
    # The twin's leg was not held to the last digit: the zero is another one.
    done = typed(monkeypatch, capsys, *resume, "--rig", rig)
    assert done.exit_code == 0, done.err
    (resumed,) = [
        event
        for event in map(json.loads, (run / "events.jsonl").read_text().splitlines())
        if event["event"] == "run resumed"
    ]
    assert resumed["zero"]["zero_policy"] == "incremental"


def test_without_a_terminal_nothing_is_written_but_by_yes(here, monkeypatch, capsys):
    rig = write_twin(here, ODRIVE, "incremental")
    before = rig.read_bytes()
    for options in ((), ("--check-direction",)):
        refused = typed(monkeypatch, capsys, "setup", "zero", "--rig", rig, *options)
        assert refused.exit_code == 2
        assert "terminal" in refused.err
        assert len(refused.err.strip().splitlines()) == 1
    assert rig.read_bytes() == before
    assert not state_file(rig).exists()


def test_a_rig_file_that_came_with_the_package_stays_as_it_is():
    refuse_shipped(ROOT / "calibration" / "twin.toml")
    with pytest.raises(BadInput, match="came with the package; copy it"):
        refuse_shipped(PACKAGE / "shipped" / "calibration" / "twin.toml")


class Hand:
    """Answers the prompts of a command, and turns the leg to the next of these angles at each."""

    def __init__(self, monkeypatch, rig: Lab, *angles_rad: float) -> None:
        self._rig = rig
        self._left = list(angles_rad)
        self.prompts: list[str] = []
        monkeypatch.setattr("sys.stdin", self)
        monkeypatch.setattr(typer, "prompt", self.prompt)
        monkeypatch.setattr(typer, "confirm", lambda *_, **__: True)

    def isatty(self) -> bool:
        return True

    def prompt(self, text: str, **_: object) -> str:
        self.prompts.append(text)
        self._rig.turn_by_hand(self._left.pop(0))
        return ""


def open_lab(monkeypatch, rig: Lab) -> None:
    """The command finds the drive of this lab on its bus."""

    def start_held(_rig, zero, _faults):
        _, bench = rig.start_driver()
        return _Held(HeldMotor(bench.motor, bench.clock, zero, 0.1))

    monkeypatch.setattr(zero_setup, "open_held_motor", start_held)


class _Held:
    def __init__(self, held: HeldMotor) -> None:
        self._held = held

    def __enter__(self) -> HeldMotor:
        return self._held

    def __exit__(self, *_: object) -> None:
        pass


@pytest.mark.parametrize("make", MAKES)
def test_at_a_real_rig_the_hand_holds_the_leg_and_lets_it_down(here, monkeypatch, capsys, make):
    with lab(here, MAKES[make], "behind-gear") as rig:
        rig.power_cycle()
        if make == "moteus":
            rig.rig.twin._powered_s -= 100.0
        open_lab(monkeypatch, rig)
        # Held 5 degrees off: the zero is as exact as it was on the first day.
        hand = Hand(monkeypatch, rig, radians(5.0), HANGING_RAD)
        said = typed(monkeypatch, capsys, "setup", "zero", "--rig", rig.path)
        assert said.exit_code == 0, said.err
        assert hand.prompts[0].startswith("motor off; hold the leg at 0 deg")
        # A moteus tells its uptime, so it does not matter where it is left.
        assert len(hand.prompts) == (1 if make == "moteus" else 2)
        rig.turn_by_hand(HANGING_RAD)
        _, error_deg = rig.run()
        assert abs(error_deg) < 0.2


def test_a_leg_that_moves_while_it_is_read_is_refused(here, monkeypatch, capsys):
    with lab(here, ODRIVE, "incremental") as rig:
        open_lab(monkeypatch, rig)
        Hand(monkeypatch, rig, 0.0)
        wait_until = rig.rig.clock.wait_until

        def wait_and_move(t_s):
            rig.rig.rotor.angle_rad += 0.002
            wait_until(t_s)

        monkeypatch.setattr(rig.rig.clock, "wait_until", wait_and_move)
        said = typed(monkeypatch, capsys, "setup", "zero", "--rig", rig.path)
        assert said.exit_code == 2
        assert "hold it still" in said.err
        assert not state_file(rig.path).exists()


@pytest.mark.parametrize(
    ("motor", "turned_deg", "exit_code", "said"),
    [
        (ODRIVE, (0.0, 30.0, 90.0), 0, ("right  zero", "right  direction", "right  gear")),
        (ODRIVE, (8.0, 38.0, 98.0), 1, ("wrong  zero", "zero_turns", "right  direction")),
        (ODRIVE, (0.0, -30.0, -90.0), 1, ("set direction = 1 under [motor]", "right  gear")),
        (ODRIVE, (0.0, 30.0, 60.0), 1, ("set gear_ratio = 6 under [motor]",)),
        (MOTEUS, (0.0, 30.0, 90.0), 0, ("right  zero", "right  direction", "right  gear")),
        (MAKES["cubemars-mit"], (0.0, 30.0, 60.0), 1, ("the drive's own gear setting",)),
    ],
)
def test_direction_and_gear_are_checked_by_hand(
    here, monkeypatch, capsys, motor, turned_deg, exit_code, said
):
    with lab(here, motor, "incremental") as rig:
        before = rig.path.read_bytes()
        open_lab(monkeypatch, rig)
        Hand(monkeypatch, rig, *map(radians, turned_deg))
        shown = typed(monkeypatch, capsys, "setup", "zero", "--rig", rig.path, "--check-direction")
        assert shown.exit_code == exit_code
        assert len(shown.out.strip().splitlines()) == 3
        for words in said:
            assert words in shown.out
        assert rig.path.read_bytes() == before


def test_the_doctor_says_what_a_run_would(here):
    def colours(rig_path, now=None):
        return [finding.colour for finding in check_zero(read_rig(rig_path), rig_path, now)]

    assert colours(write_rig(here, ODRIVE, None)) == [Colour.YELLOW]
    assert colours(write_rig(here, ODRIVE, "absolute")) == [Colour.GREEN]
    assert colours(write_rig(here, ODRIVE, "incremental")) == [Colour.RED]
    assert colours(write_twin(here, ODRIVE, None)) == []
    with lab(here, ODRIVE, "incremental") as rig:
        rig.check_zero()
        assert colours(rig.path) == [Colour.GREEN]
        described, bench = rig.start_driver()
        held = HeldMotor(bench.motor, bench.clock, described.motor.encoder_zero, 0.1)
        assert colours(rig.path, held.read()) == [Colour.GREEN]
        rig.power_cycle()
        (finding,) = check_zero(described, rig.path, held.read())
        assert finding.colour is Colour.RED
        assert finding.commands == (f"rfca-rig setup zero --rig {rig.path}",)
        state_file(rig.path).write_text("not JSON")
        assert colours(rig.path) == [Colour.RED]


def test_the_zero_of_a_twin_is_where_its_file_parks_it(here, monkeypatch, capsys):
    rig = write_twin(here, ODRIVE.replace("2.75", "1.0"), "incremental")
    said = typed(monkeypatch, capsys, "setup", "zero", "--rig", rig, "--yes", *RESTART)
    assert said.exit_code == 0, said.err
    described = read_rig(rig)
    zero = described.motor.encoder_zero
    parked_deg = degrees(zero.angle_rad(0.0))
    # It falls while it is read: by a quarter of a degree.
    assert parked_deg == pytest.approx(described.rig.parked_angle_deg, abs=0.3)
    assert np.isfinite(read_check(rig).left_reading)
