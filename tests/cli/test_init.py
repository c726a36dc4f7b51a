"""`init --rig`: ten questions, and a commented rig file that every other command reads."""

import io
import sys

import pytest

from rfca_rig.campaign.reading import read_campaign
from rfca_rig.description.rig_draft import USUAL
from rfca_rig.description.rig_file import read_rig
from rfca_rig.devices import FORCE_SENSORS, MOTORS, OWN, checks
from rfca_rig.devices.netft import checks as netft_checks
from rfca_rig.devices.netft.checks import BoxObservation
from rfca_rig.devices.netft.codec import CalibrationInfo
from rfca_rig.doctor import ports
from tests.campaign.foreign import Format, Written, write_folder
from tests.campaign.small import SMALL
from tests.cli.typed import typed


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Computer:
    """A computer without devices, to which a test adds some; `say` types answers."""

    def __init__(self, monkeypatch, capsys):
        self.monkeypatch = monkeypatch
        self.capsys = capsys
        self.has(buses=(), adapters=(), ports=(), box=BoxObservation("192.168.1.1", None, "silent"))

    def has(self, **devices):
        replaced = {
            "buses": (ports, "can_interfaces"),
            "adapters": (ports, "look_for_adapters"),
            "ports": (checks, "look_for_serial_ports"),
            "box": (netft_checks, "look_for_box"),
        }
        for name, found in devices.items():
            self.monkeypatch.setattr(*replaced[name], lambda found=found: found)

    def init(self, *words, answers: str | None = "", stream=io.StringIO):
        self.monkeypatch.setattr(sys, "stdin", None if answers is None else stream(answers))
        return typed(self.monkeypatch, self.capsys, "init", *words)


@pytest.fixture
def computer(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    return Computer(monkeypatch, capsys)


def test_every_suggestion_together_is_the_twin_with_coulomb_friction(computer, tmp_path):
    said = computer.init("--rig", "our-rig.toml", "--yes")
    assert said.exit_code == 0
    assert "--rig our-rig.toml --height 215 --speed 2.433" in said.err
    rig = read_rig(tmp_path / "our-rig.toml")
    assert not rig.is_real
    assert (sum(rig.leg.link_lengths_mm), rig.motor.device, rig.force_sensor.device) == (
        pytest.approx(290, abs=0.01),
        "odrive",
        "ati-net-ft",
    )
    assert rig.ground.tangential_damping_N_s_per_m == 0.0
    # Its camera is calibrated beside it.
    assert rig.eye() is not None


def test_answers_stand_in_the_file_and_what_was_not_asked_is_marked(computer, tmp_path):
    answers = (
        "60 50 50\n100 90 90\n-20\n120\n9\nmoteus\npcan PCAN_USBBUS1\n7\nati-serial\n/dev/ttyS3\n"
    )
    assert computer.init("--rig", "our-rig.toml", answers=answers).exit_code == 0
    text = (tmp_path / "our-rig.toml").read_text()
    rig = read_rig(tmp_path / "our-rig.toml")
    assert (rig.leg.link_lengths_mm, rig.leg.link_masses_g) == ((60, 50, 50), (100, 90, 90))
    assert (rig.sensor.below_shaft_mm, rig.limits.force_N, rig.limits.torque_Nm) == (-20, 120, 9)
    assert (rig.motor.device, rig.motor.interface, rig.motor.channel, rig.motor.drive_id) == (
        "moteus",
        "pcan",
        "PCAN_USBBUS1",
        7,
    )
    assert rig.force_sensor.port == "/dev/ttyS3"
    lines = {line.partition(" = ")[0]: line for line in text.splitlines()}
    assert (
        USUAL in lines["k0_Nm_per_rad"]
        and USUAL not in lines["force_N"]
        and USUAL not in lines["drive_id"]
    )


@pytest.mark.parametrize("drive", [kind for kind in MOTORS if kind != OWN])
@pytest.mark.parametrize("sensor", [kind for kind in FORCE_SENSORS if kind != OWN])
def test_every_pair_of_devices_makes_a_file_that_is_read(computer, tmp_path, drive, sensor):
    assert (
        computer.init(
            "--rig", "our-rig.toml", answers=f"\n\n\n\n\n{drive}\n\n\n{sensor}\n\n"
        ).exit_code
        == 0
    )
    rig = read_rig(tmp_path / "our-rig.toml")
    assert (rig.motor.device, rig.force_sensor.device) == (drive, sensor)


def test_allowed_values_stand_beside_the_keys(computer, tmp_path):
    computer.init("--rig", "our-rig.toml", "--yes")
    text = (tmp_path / "our-rig.toml").read_text()
    # [known_to] has a start angle as well, behind that of the leg.
    lines = {line.partition(" =")[0]: line for line in reversed(text.splitlines())}
    assert '"cubemars-mit", "cubemars-servo", "moteus", "odrive", "own"' in text
    assert ">= 0, <= 62" in lines["node_id"]
    assert '"0.5", "0.6"; optional' in lines["# dialect"]
    # In the unit of the key.
    assert ">= -180, <= 180" in lines["start_angle_deg"]


def test_devices_that_are_there_are_suggested(computer, tmp_path):
    computer.has(
        buses=("can3",),
        box=BoxObservation("10.0.0.5", CalibrationInfo("N", "Nm", 2_000_000, 50_000_000, (1,) * 6)),
    )
    said = computer.init("--rig", "our-rig.toml", "--yes")
    assert "found on this computer: socketcan can3, Net F/T at 10.0.0.5" in said.err
    rig = read_rig(tmp_path / "our-rig.toml")
    assert (rig.motor.channel, rig.force_sensor.host) == ("can3", "10.0.0.5")
    # The box itself states its counts, so they need no check.
    assert (rig.force_sensor.counts_per_N, rig.force_sensor.counts_per_Nm) == (2e6, 5e7)
    assert USUAL not in next(
        line
        for line in (tmp_path / "our-rig.toml").read_text().splitlines()
        if line.startswith("counts_per_N ")
    )


def test_on_a_terminal_an_answer_that_cannot_be_is_asked_for_again(computer, tmp_path):
    answers = (
        "60 x\n60 50\n100\n100 0\n100 90\n\n\n\nodriv\nodrive\ncan0\nsocketcan can1\n-1\n5\n\n\n"
    )
    said = computer.init("--rig", "our-rig.toml", answers=answers, stream=Terminal)
    assert said.exit_code == 0
    for reason in (
        "give numbers",
        "give 2 numbers, not 1",
        "above 0",
        "give one of odrive",
        "two words",
        "from 0 to 127",
    ):
        assert reason in said.out + said.err
    assert read_rig(tmp_path / "our-rig.toml").motor.node_id == 5


@pytest.mark.parametrize(
    ("words", "answers", "message"),
    [
        # A closed standard input, an empty one, and fewer answers than questions.
        (
            ("--rig", "our-rig.toml"),
            None,
            "holds 0 of 10 answers; none for question 1, lengths of the links",
        ),
        (("--rig", "our-rig.toml"), "", "holds 0 of 10 answers"),
        (
            ("--rig", "our-rig.toml"),
            "60 50\n",
            "holds 1 of 10 answers; none for question 2, their masses, g; give one answer per line",
        ),
        # From a pipe a wrong answer cannot be asked for again: the next line answers the next
        # question.
        (("--rig", "our-rig.toml"), "60 x\n" + "\n" * 9, "answer 1 of 10, lengths of the links"),
        (
            ("--rig", "our-rig.toml"),
            "\n\n\n\n\nodriv\n" + "\n" * 4,
            "'odriv'; give one of odrive, cubemars-mit",
        ),
        (("--rig", "nowhere/our-rig.toml", "--yes"), "", "there is no folder nowhere"),
        ((), "", "give --rig FILE"),
        (("--rig", "our-rig.toml", "--data", "."), "", "give --rig FILE"),
        (("--mjcf", "arm.xml"), "", "--mjcf FILE and --data DIR"),
        # Only the drive's section knows that its numbers end at 63.
        (("--rig", "our-rig.toml"), "\n\n\n\n\nodrive\n\n99\n\n\n", "motor.node_id"),
    ],
)
def test_what_cannot_be_is_one_line_and_writes_nothing(computer, tmp_path, words, answers, message):
    said = computer.init(*words, answers=answers)
    assert said.exit_code == 2
    assert message in said.err.splitlines()[-1]
    assert "/10" not in said.out + said.err
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_there_stays(computer, tmp_path):
    (tmp_path / "our-rig.toml").write_text("mine")
    assert computer.init("--rig", "our-rig.toml", "--yes").exit_code == 2
    assert (tmp_path / "our-rig.toml").read_text() == "mine"


def test_a_leg_that_the_twins_camera_does_not_see_whole_has_none(computer, tmp_path):
    computer.init("--rig", "our-rig.toml", answers="200 200\n" + "\n" * 9)
    assert read_rig(tmp_path / "our-rig.toml").camera is None
    assert not (tmp_path / "twin-camera.toml").exists()


def test_recordings_of_a_leg_become_a_campaign_that_check_and_report_take(
    monkeypatch, capsys, tmp_path
):
    monkeypatch.chdir(tmp_path)
    theirs = read_campaign(SMALL)
    how = Format(
        {
            "t_s": Written("Zeit [ms]", "ms"),
            "shaft_angle_rad": Written("Winkel [deg]", "deg"),
            "fz_N": Written("Kraft z", "kN", -1),
        },
        separator=";",
        decimal=",",
        shift_s=1.25,
    )
    write_folder(tmp_path / "theirs", theirs, how)
    before = {path: path.read_bytes() for path in (tmp_path / "theirs").iterdir()}
    said = typed(monkeypatch, capsys, "init", "--data", "theirs")
    assert said.exit_code == 0
    assert "theirs/campaign.toml: 1 values to fill in" in said.out
    assert "then: rfca-rig check theirs" in said.err
    said = typed(monkeypatch, capsys, "check", "theirs")
    assert said.exit_code == 2
    assert "columns.fz_N.unit: is still a question mark" in said.err
    campaign = tmp_path / "theirs" / "campaign.toml"
    text = campaign.read_text(encoding="utf-8").replace('unit = "?"', 'unit = "kN"')
    campaign.write_text(text, encoding="utf-8")
    said = typed(monkeypatch, capsys, "check", "theirs")
    assert said.exit_code == 0
    assert "4 strokes and 0 static stages, values plausible" in said.err
    assert "usual values are marked in theirs/campaign.toml" in said.err
    assert typed(monkeypatch, capsys, "report", "theirs", "--out", "page").exit_code == 0
    for path, content in before.items():
        assert path.read_bytes() == content
    # A draft is never written over.
    said = typed(monkeypatch, capsys, "init", "--data", "theirs")
    assert said.exit_code == 2
    assert "campaign.toml: is there already" in said.err


def test_a_folder_that_is_not_there_is_one_line(computer):
    said = computer.init("--data", "nowhere")
    assert said.exit_code == 2
    assert "nowhere: is not there, or no folder" in said.err
