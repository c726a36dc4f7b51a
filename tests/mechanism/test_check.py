"""`check` of recordings of a mechanism: what can be used, and signs, units and columns that are
probably wrong, each in one line.
"""

import json
import shutil
from dataclasses import replace
from itertools import takewhile

import numpy as np
import pytest

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.diagnose import diagnose
from rfca_rig.diagnosis.mechanisms.check import check_experiment, locate_minimum
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.diagnosis.problem import FitOptions
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.mechanism.inverse_dynamics import States, balance_torques
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.progress import ignore_share
from tests.cli.typed import typed
from tests.mechanism.arm import Arm, Friction, _rate, mjcf, record, write_campaign
from tests.public_recordings import write_public_set

# what a model usually lacks must not look like a wrong sign
ARM = replace(Arm(), friction=Friction((0.0, 0.4, 0.0)))


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    known_to = {"mass_relative": 0.02, "zero_offset_rad": 0.002}
    return write_campaign(
        tmp_path_factory.mktemp("check") / "arm",
        Arm(),
        [record(ARM, 3.4, seed) for seed in (0, 1)],
        known_to,
    )


@pytest.fixture
def folder(campaign, tmp_path):
    return shutil.copytree(campaign, tmp_path / "arm")


@pytest.fixture(scope="module")
def sound(campaign):
    """The lines on these recordings as they are."""
    return list(check_experiment(campaign))


def edit(path, *changes):
    text = path.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")


def edit_column(folder, column, change, files=("run1.csv", "run2.csv")):
    for file in files:
        head = (folder / file).read_text(encoding="utf-8").partition("\n")[0]
        rows = np.loadtxt(folder / file, delimiter=",", skiprows=1)
        place = head.split(",").index(column)
        rows[:, place] = change(rows[:, place])
        np.savetxt(folder / file, rows, delimiter=",", header=head, comments="", fmt="%.8g")


def warnings(lines):
    return [f"{line.about} {line.name}: {line.words}" for line in lines if line.is_warning]


def until_priors(folder):
    """The lines that need no simulation."""
    return takewhile(lambda line: line.about != "known_to", check_experiment(folder))


def reverse(*columns):
    return [
        (f'column = "{column}", unit', f'column = "{column}", sign = -1, unit')
        for column in columns
    ]


@pytest.mark.slow
def test_sound_recordings_have_a_line_for_each_thing_and_no_warning(sound):
    assert not [line for line in sound if line.is_warning]
    names = {}
    for line in sound:
        names.setdefault(line.about, []).append(line.name)
    assert names["model"] == ["model.xml"]
    assert names["recording"] == ["sines 1, repeat 1", "sines 2, repeat 1"]
    assert names["signal"] == names["prediction"] == ["q1", "q2", "q3", "w1", "w2", "w3"]
    assert names["balance"] == ["joint1", "joint2", "joint3"]
    assert names["command"] == ["tau1", "tau2", "tau3"]
    found = {(line.about, line.name): line.values for line in sound}
    assert found["model", "model.xml"] == {"mass_kg": pytest.approx(4.1)}
    assert found["recording", "sines 1, repeat 1"] == pytest.approx(
        {
            "length_s": 3.398,
            "rate_Hz": 500.0,
            "largest_gap_s": 0.002,
            "windows": 6,
            "usable_windows": 6,
        }
    )
    assert found["signal", "q1"]["noise"] == pytest.approx(np.degrees(ARM.angle_error_rad), rel=0.1)
    assert found["signal", "w3"]["ratio"] == pytest.approx(1.0, abs=0.01)
    assert (
        found["balance", "joint1"]["imbalance"]
        < 0.02
        < found["balance", "joint2"]["imbalance"]
        < 0.2
    )
    assert found["command", "tau1"]["gain"] == pytest.approx(1.0, abs=0.02)
    assert found["known_to", "priors"] == {"parameters": 6}
    assert found["integrator", "step"] == {"step_s": 0.008}


@pytest.mark.slow
def test_errors_of_the_prediction_are_in_the_unit_of_the_column(sound, folder):
    in_deg = {line.name: line.values for line in sound if line.about == "prediction"}
    edit_column(folder, "q1", np.radians)
    edit(folder / "experiment.toml", ('column = "q1", unit = "deg"', 'column = "q1", unit = "rad"'))
    in_rad = {
        line.name: line.values for line in check_experiment(folder) if line.about == "prediction"
    }
    assert in_rad["q1"]["miss"] == pytest.approx(np.radians(in_deg["q1"]["miss"]), rel=1e-3)
    assert in_rad["q2"]["miss"] == pytest.approx(in_deg["q2"]["miss"], rel=1e-3)


@pytest.mark.slow
def test_a_prediction_that_misses_by_more_than_the_signal_changes_has_a_hint(folder):
    edit_column(folder, "w1", lambda speed: -speed)
    found = {
        line.name: line
        for line in check_experiment(folder)
        if line.about == "prediction" and not line.is_warning
    }
    # The windows start from the recorded speeds, so that of one joint disturbs the others.
    missed = {name for name, line in found.items() if line.values["miss"] > line.values["change"]}
    assert "w1" in missed and "q1" not in missed
    hint = "misses by more than the signal changes: check its sign"
    assert {name for name, line in found.items() if hint in line.words} == missed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "fix"),
    [
        (
            reverse("q2", "w2"),
            "set sign = 1 in signals[2] (q2) and sign = 1 in signals[5] (w2); torques",
        ),
        (reverse("q2"), "set sign = 1 in signals[2] (q2); torques"),
        (
            reverse("w2"),
            "signal w2: is -1 times the derivative of q2; set sign = 1 in signals[5] (w2)",
        ),
        (reverse("tau3"), "set sign = 1 in commands[3] (tau3); torques"),
        (
            reverse("q1", "w1", "tau3"),
            (
                "set sign = 1 in signals[1] (q1) and sign = 1 in signals[4] (w1), sign = 1 "
                "in commands[3] (tau3);"
            ),
        ),
        (
            reverse("tau1", "tau2", "tau3"),
            (
                "or sign = 1 in commands[1] (tau1), sign = 1 in commands[2] (tau2), sign = 1 "
                "in commands[3] (tau3)"
            ),
        ),
        (
            [('column = "q1", unit = "deg"', 'column = "q1", unit = "rad"')],
            'set unit = "deg" in signals[1] (q1); torques',
        ),
        (
            [('column = "w1", unit = "rad/s"', 'column = "w1", unit = "deg/s"')],
            'set unit = "rad/s" in signals[4] (w1)',
        ),
        (
            [('column = "tau1", unit = "N m"', 'column = "tau1", unit = "mN m"')],
            'set unit = "N m" in commands[1] (tau1); torques',
        ),
        (
            [
                (
                    'column = "q1", unit = "deg"',
                    'column = "q1", unit = "count", counts_per_turn = 720',
                )
            ],
            "set counts_per_turn = about 360 in signals[1]",
        ),
        (
            [('column = "w1", unit', 'column = "w3", unit')],
            "signal w3: does not follow the derivative of q1",
        ),
        (
            [('column = "q1", unit', 'column = "q1", noise_std = 0.0001, unit')],
            "noise_std = 0.0001 is stated",
        ),
    ],
)
def test_a_wrong_sign_or_unit_is_one_warning_with_the_fix(folder, changes, fix):
    edit(folder / "experiment.toml", *changes)
    (said,) = warnings(until_priors(folder))
    assert fix in said


def diagnose_all(problem):
    return diagnose(problem, ignore_share)


def fit_all(problem):
    return problem.fit(FitOptions(), ignore_share)


@pytest.mark.parametrize("use", [diagnose_all, fit_all])
def test_a_misread_column_is_neither_diagnosed_nor_fitted(folder, monkeypatch, use):
    edit(folder / "experiment.toml", *reverse("tau3"))
    experiment = read_experiment(folder)
    with pytest.raises(
        BadInput,
        match=r"experiment.toml: set sign = 1 in commands\[3\] \(tau3\); .* take it with --as-is",
    ):
        use(MechanismProblem(experiment))

    def stop(*_):
        raise SimulationFailed("it came to the windows")

    monkeypatch.setattr("rfca_rig.diagnosis.mechanisms.problem.prepare_mechanism", stop)
    with pytest.raises(SimulationFailed, match="it came to the windows"):
        use(MechanismProblem(experiment, as_is=True))


@pytest.mark.slow
def test_a_prior_without_an_object_is_warned_of_and_a_wrong_sign_only_once(folder):
    edit(
        folder / "experiment.toml",
        *reverse("q2"),
        ("[known_to]", "[known_to]\nzero_offset_m = 0.1"),
    )
    sign, prior = warnings(check_experiment(folder))
    assert "signals[2]" in sign
    assert prior == "known_to zero_offset_m: the model has no slides; remove it"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("column", "change", "files", "said"),
    [
        ("w2", np.zeros_like, ("run1.csv", "run2.csv"), "signal w2: column w2 is 0 in all samples"),
        (
            "tau2",
            np.zeros_like,
            ("run1.csv", "run2.csv"),
            "command tau2: column tau2 is 0 in all samples",
        ),
        (
            "w2",
            np.zeros_like,
            ("run2.csv",),
            "signal w2: column w2 never changes in sines 2, repeat 1",
        ),
        (
            "q3",
            lambda q: 4.0 * np.round(q / 4.0),
            ("run1.csv", "run2.csv"),
            "steps over the whole range",
        ),
        ("q3", lambda q: (q - q.mean()) % 360.0, ("run1.csv",), "signal q3: jumps by 3"),
        (
            "t",
            lambda t: np.where(t > 1.0, t + 0.2, t),
            ("run1.csv",),
            "recording sines 1, repeat 1: 2 windows hold or touch a gap",
        ),
    ],
)
def test_a_column_that_is_dead_coarse_wrapped_or_has_a_gap_is_warned_of(
    folder, column, change, files, said
):
    edit_column(folder, column, change, files)
    assert any(said in warning for warning in warnings(until_priors(folder)))


def lose_sign(w):
    """A speed in thousandths, as a register of 16 bits without its sign holds it."""
    return np.mod(np.round(1e3 * w), 2.0**16)


def jump_once(q):
    return np.where(np.arange(q.size) == 700, q + 30.0, q)


def hold(w):
    return np.repeat(w[::50], 50)[: w.size]


def delay(w):
    """Six samples of 2 ms late."""
    return np.r_[w[:1].repeat(6), w[:-6]]


def cut_off(w):
    limit = 0.5 * np.abs(w).max()
    return np.clip(w, -limit, limit)


@pytest.mark.parametrize(
    ("column", "change", "said"),
    [
        ("q1", jump_once, "signal q1: 2 samples jump away and come back; they are left out, first"),
        ("w2", lose_sign, "signal w2: jumps across 65536 in sines 1, repeat 1: a register of 16"),
        ("w2", hold, "signal w2: changes only every 50 samples (0.1 s) of sines 1, repeat 1"),
        ("w1", delay, "signal w1: runs 12 ms behind the derivative of q1"),
        ("w1", cut_off, "the sensor is at its limit"),
    ],
)
def test_a_fault_of_a_column_is_warned_of(folder, column, change, said):
    edit_column(folder, column, change)
    assert any(said in warning for warning in warnings(until_priors(folder)))


def test_a_sample_that_jumps_changes_nothing_but_itself(folder):
    sound = read_experiment(folder)
    edit_column(folder, "q1", jump_once, ("run1.csv",))
    spoiled = read_experiment(folder)
    assert spoiled.runs[1].glitches == ()
    (glitch,) = spoiled.runs[0].glitches
    assert (glitch.column, glitch.jump) == ("q1", pytest.approx(30.0, rel=0.05))
    kept = sound.runs[0].t_s != glitch.t_s
    assert np.count_nonzero(~kept) == 1
    assert np.array_equal(spoiled.runs[0].signals, sound.runs[0].signals[kept])
    assert np.array_equal(spoiled.runs[0].commands, sound.runs[0].commands[kept])


@pytest.mark.slow
def test_a_recording_that_is_too_short_and_too_few_stretches_are_warned_of(folder):
    edit(folder / "experiment.toml", ('file = "run2.csv",', 'file = "run2.csv", to_s = 0.5,'))
    short, few = warnings(check_experiment(folder))
    assert "recording sines 2, repeat 1: too short for a window, which needs 0.62 s" in short
    assert "2 stretches of about 4 windows" in few and "diagnose needs 3" in few


def forget_recordings(folder):
    lines = (folder / "experiment.toml").read_text(encoding="utf-8").splitlines()
    kept = ["recordings = []" if line.startswith("recordings") else line for line in lines]
    (folder / "experiment.toml").write_text("\n".join(kept), encoding="utf-8")


def stop_clock(t):
    return np.where(np.arange(t.size) == 100, t[90], t)


@pytest.mark.parametrize(
    ("break_it", "said"),
    [
        (
            lambda f: edit_column(f, "q2", lambda q: np.where(q == q[4], np.nan, q), ("run1.csv",)),
            "run1.csv:6: column q2: nan is not a value",
        ),
        (
            lambda f: edit_column(f, "t", stop_clock, ("run1.csv",)),
            "run1.csv:102: time does not run forwards",
        ),
        (
            lambda f: edit(f / "experiment.toml", ('joint = "joint3"', 'joint = "joint4"')),
            "joint 'joint4' is not in the model",
        ),
        (
            lambda f: edit(f / "experiment.toml", ('actuator = "motor3"', 'actuator = "m"')),
            "actuator 'm' is not in the model",
        ),
        (forget_recordings, "recordings: should have 1 or more entries, not 0"),
        (
            lambda f: edit(
                f / "experiment.toml", ('column = "t", unit = "s"', 'column = "t", unit = "ms"')
            ),
            "is the unit of the time another?",
        ),
        (
            lambda f: edit(
                f / "experiment.toml", ("[known_to]", "windows = { bin_s = 0.001 }\n[known_to]")
            ),
            "has a gap longer than bin_s",
        ),
        (
            lambda f: edit(f / "model.xml", ('name="joint3"', 'name="joint3" damping="1e6"')),
            "the simulation diverges",
        ),
        (lambda f: (f / "model.xml").unlink(), "model.xml: is not there"),
    ],
)
def test_what_cannot_be_used_is_one_line_and_exit_code_2(
    folder, monkeypatch, capsys, break_it, said
):
    break_it(folder)
    answer = typed(monkeypatch, capsys, "check", folder)
    assert answer.exit_code == 2
    assert said in answer.err
    assert answer.err.count("\n") == 1


def test_a_time_in_another_unit_is_seen_in_the_speeds_too(folder, monkeypatch, capsys):
    edit(folder / "experiment.toml", ('column = "t", unit = "s"', 'column = "t", unit = "ms"'))
    assert 'set unit = "s" in [time]' in " ".join(
        typed(monkeypatch, capsys, "check", folder).out.split()
    )


@pytest.mark.slow
def test_the_terminal_and_json_say_the_same(folder, monkeypatch, capsys):
    edit(folder / "experiment.toml", *reverse("w2"))
    shown = typed(monkeypatch, capsys, "check", folder)
    assert shown.exit_code == 0
    assert "WARNING signal w2: is -" in shown.out
    assert max(map(len, shown.out.splitlines())) <= 80
    assert shown.err.endswith("can be used; 1 warning\n")
    told = json.loads(typed(monkeypatch, capsys, "check", folder, "--json").out)
    assert told["usable"] is True
    assert [row["name"] for row in told["lines"] if row["warning"]] == ["w2"]
    (folder / "model.xml").unlink()
    refused = typed(monkeypatch, capsys, "check", folder, "--json")
    assert refused.exit_code == 2
    assert "is not there" in json.loads(refused.out)["refused"]


@pytest.mark.parametrize("name", ["simple", "double", "free-swing", "flexible-link"])
def test_no_sign_and_no_unit_of_real_recordings_is_doubted(tmp_path, name):
    write_public_set(name, tmp_path)
    assert not warnings(until_priors(tmp_path))


def test_inverse_dynamics_agree_with_the_equations_of_the_other_engine(tmp_path):
    (tmp_path / "model.xml").write_text(mjcf(Arm()), encoding="utf-8")
    random = np.random.default_rng(0)
    position, speed, torque = (random.uniform(-2.0, 2.0, (20, 3)) for _ in range(3))
    states = [np.concatenate([q, w, np.zeros(3)]) for q, w in zip(position, speed, strict=True)]
    acceleration = np.array(
        [_rate(Arm(), state, tau)[3:6] for state, tau in zip(states, torque, strict=True)]
    )
    balance = balance_torques(
        load_mechanism(tmp_path / "model.xml"), States(position, speed, acceleration, torque)
    )
    assert np.abs(balance.remainder).max() < 1e-9
    doubled = balance_torques(
        load_mechanism(tmp_path / "model.xml"), States(position, speed, acceleration, 2.0 * torque)
    )
    assert doubled.gain(1) == pytest.approx((0.5, 1.0))


def list_delays(arm, folder):
    """Delays of the commands in s that a check of recordings of an arm warns of."""
    write_campaign(folder, Arm(), [record(arm, 6.0, seed) for seed in (1, 2)], {})
    warnings = [line for line in check_experiment(folder) if line.name == "all commands"]
    return [line.values["delay_s"] for line in warnings]


def test_commands_that_act_late_are_warned_of(tmp_path):
    late = replace(Arm(), torque_delay_s=0.01)
    assert list_delays(late, tmp_path / "arm") == [pytest.approx(0.01, abs=0.001)]


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"friction": Friction((0.6, 0.25, 0.07), 0.3, 0.3)},
        {"friction": Friction((0.0, 0.0, 0.0), viscous_Nm_s_per_rad=(0.5, 0.2, 0.05))},
        {"rotor_kg_m2": (0.1, 0.03, 0.004)},
        {"torque_factor": 0.85},
    ],
    ids=["nothing", "dry", "viscous", "rotors", "scale"],
)
def test_what_else_a_model_lacks_is_no_delay(tmp_path, changes):
    assert list_delays(replace(Arm(), **changes), tmp_path / "arm") == []


def test_the_least_of_a_parabola_is_found_between_its_places():
    places = np.linspace(-1.0, 1.0, 11)
    place, value = locate_minimum(places, 3.0 + 2.0 * (places - 0.13) ** 2)
    assert place == pytest.approx(0.13)
    assert value == pytest.approx(3.0)
    assert locate_minimum(places, places) == (-1.0, -1.0)


def test_values_that_the_recordings_do_not_show_are_named(folder):
    """A damping of 1e-6 N m s/rad is far below what these recordings could tell."""
    edit(
        folder / "experiment.toml",
        ("[known_to]", "[known_to]\njoint_damping_Nm_s_per_rad = 1e-6"),
    )
    (line,) = [line for line in check_experiment(folder) if line.name == "identifiability"]
    assert line.values["joint1.zero_offset_rad"] < 0.9
    assert line.values["joint3.joint_damping_Nm_s_per_rad"] > 0.99
    assert "joint3.joint_damping_Nm_s_per_rad" in line.words
    assert "joint1.zero_offset_rad" not in line.words
