"""Drive and sensor of an installed package: offered by an entry point, named in a rig file, and
used as any other.
"""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from rfca_rig.bench.factory import open_bench
from rfca_rig.clock import TwinClock
from rfca_rig.contracts.own_devices import (
    MotorOfAMake,
    find_conformance_tests,
    run_conformance_tests,
)
from rfca_rig.description.rig_draft import RigAnswers, draft_rig
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.devices import MOTORS, MotorMake, find_motor, list_motors, package_of
from rfca_rig.devices.checks import Colour
from rfca_rig.devices.own import packages_of
from rfca_rig.doctor.rig_checks import (
    check_own_motor,
    check_sensor,
    judge_own_motor,
    judge_own_sensor,
)
from rfca_rig.engine.run import prove_stop
from rfca_rig.errors import BadInput
from rfca_rig.recording.store import read_recording
from rfca_rig.toml import model_of, read_data
from tests.cli.typed import typed
from tests.own_devices.rigs import EXAMPLES, ROOT

PAGE = (
    (ROOT / "docs" / "add-a-motor.md")
    .read_text()
    .partition("## For several rigs: a package")[2]
    .partition("\n## ")[0]
)
RIG_SECTION, PROJECT = re.findall(r"(?s)```toml\n(.*?)```", PAGE)
(INIT,) = re.findall(r"(?s)```python\n(.*?)```", PAGE)

# A build backend without dependencies, so that pip needs neither a network nor setuptools.
BACKEND = """
import tomllib, zipfile
from pathlib import Path

def build_wheel(folder, config_settings=None, metadata_directory=None):
    project = tomllib.loads(Path("pyproject.toml").read_text())["project"]
    wheel = f"{project['name'].replace('-', '_')}-{project['version']}"
    info, name = f"{wheel}.dist-info", f"{wheel}-py3-none-any.whl"
    points = (f"[{group}]\\n" + "".join(f"{kind} = {place}\\n" for kind, place in table.items())
              for group, table in project["entry-points"].items())
    files = {str(path): path.read_text() for path in Path("our_drive").glob("*.py")} | {
        f"{info}/METADATA": f"Metadata-Version: 2.1\\nName: {project['name']}\\nVersion: {project['version']}\\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\\nGenerator: test\\nRoot-Is-Purelib: true\\nTag: py3-none-any\\n",
        f"{info}/entry_points.txt": "\\n".join(points),
    }
    files[f"{info}/RECORD"] = "".join(f"{file},,\\n" for file in [*files, f"{info}/RECORD"])
    with zipfile.ZipFile(Path(folder) / name, "w") as archive:
        for file, text in files.items():
            archive.writestr(file, text)
    return name
"""
BUILD_SYSTEM = '[build-system]\nrequires = []\nbuild-backend = "backend"\nbackend-path = ["."]\n'


def write_package(folder: Path) -> None:
    """The package of docs/add-a-motor.md, with the files of the worked example."""
    motor = (EXAMPLES / "our_motor.py").read_text()
    for old, new in (
        ("MotorKeys", "SpeedDriveKeys"),
        ("import Annotated", "import Annotated, Literal"),
        ("    node_id:", '    device: Literal["our-drive"]\n    node_id:'),
        ("\n\nMOTOR = OurKeys\n", ""),
    ):
        assert old in motor
        motor = motor.replace(old, new)
    inside = folder / "our_drive"
    inside.mkdir(parents=True)
    (inside / "__init__.py").write_text(INIT)
    (inside / "motor.py").write_text(motor)
    (inside / "twin.py").write_text(
        (EXAMPLES / "our_motor_twin.py").read_text().replace("\n\nTWIN = OurTwin\n", "")
    )


def state_package(folder: Path, name: str, *points: str) -> None:
    """The metadata of an installed package with these entry points."""
    info = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("\n".join(("[rfca_rig.devices]", *points)) + "\n")


def rig_with_section(folder: Path, section: str = RIG_SECTION) -> Path:
    """The shipped twin's file with that motor."""
    text = (ROOT / "calibration" / "twin.toml").read_text().partition("[twin.camera]")[0]
    rig = folder / "rig.toml"
    rig.write_text(re.sub(r"(?ms)^\[motor\]\n.*?(?=^\[)", lambda _: f"{section}\n", text))
    return rig


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder in which packages are installed, for this test."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    yield folder
    for name in [
        name
        for name in sys.modules
        if name.partition(".")[0] in {"our_drive", "our_sensor", "broken_drive"}
    ]:
        del sys.modules[name]


@pytest.fixture
def installed(site):
    write_package(site)
    state_package(site, "our-drive", "our-drive = our_drive:DEVICE")
    return site


@pytest.fixture
def rig(installed, tmp_path):
    return rig_with_section(tmp_path)


class TestTheMotorOfAPackage(MotorOfAMake):
    """The conformance tests, as `rfca-rig contract` runs them."""

    @pytest.fixture(autouse=True)
    def _of_the_package(self, rig):
        self.use(read_rig(rig).motor)


def test_its_section_is_read_and_its_driver_moves_its_twin(rig):
    read = read_rig(rig)
    assert type(read.motor).__module__ == "our_drive.motor"
    assert read.facts().rates.shaft_Hz == 500.0
    with open_bench(read, 1) as bench:
        assert judge_own_motor(bench.motor, bench.clock).colour is Colour.GREEN
        assert 0.1 <= prove_stop(bench) <= 0.13
    assert find_conformance_tests(read)[0].endswith("::TestOurMotor")


def test_the_doctor_names_the_kind(rig):
    keys = read_rig(rig).motor.model_copy(update={"channel": "can77"})
    first, second = check_own_motor(keys, TwinClock())
    assert first.seen == "our-drive is loaded, its keys in [motor] are right"
    assert "cannot be opened" in second.seen


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            ("node_id = 5", "node = 5"),
            r"rig\.toml:\d+: motor\.node: unknown key; did you mean node_id\?$",
        ),
        (
            ("node_id = 5", "node_id = 400"),
            r"rig\.toml:\d+: motor\.node_id: should be less than or equal to 126, not 400",
        ),
        (("counts_per_turn = 16384.0", ""), r"rig\.toml:\d+: motor\.counts_per_turn: missing"),
        (
            ("rated_torque_Nm = 1.2", 'file = "our_motor.py"'),
            r"rig\.toml:\d+: motor\.file: unknown key; known are direction, .*, node_id",
        ),
        (
            ('"our-drive"', '"our-driv"'),
            (
                r"rig\.toml:\d+: motor: 'device' should be one of 'odrive', .*, 'our-drive', "
                r"not 'our-driv'$"
            ),
        ),
    ],
)
def test_what_is_wrong_with_its_section_is_said_in_one_line(installed, tmp_path, change, said):
    with pytest.raises(BadInput, match=said) as refused:
        read_rig(rig_with_section(tmp_path, RIG_SECTION.replace(*change)))
    assert "\n" not in str(refused.value)


def test_init_drafts_a_file_with_it(installed, tmp_path):
    keys = tomllib.loads(RIG_SECTION)["motor"]
    usual = {
        key: keys[key]
        for key in (
            "gear_ratio",
            "zero_turns",
            "report_period_ms",
            "counts_per_turn",
            "rated_torque_Nm",
        )
    }
    init = installed / "our_drive" / "__init__.py"
    init.write_text(INIT.replace(", twin=", f', number=("node_id", 5), usual={usual!r}, twin='))
    answers = RigAnswers(
        (60.0, 50.0),
        (100.0, 90.0),
        -20.0,
        120.0,
        9.0,
        "our-drive",
        "socketcan",
        "can0",
        7,
        "ati-net-ft",
        "10.0.0.5",
    )
    text = draft_rig("ours", answers, read_data(ROOT / "calibration" / "twin.toml"))
    motor = model_of(text, RigFile, tmp_path / "ours.toml").motor
    assert (motor.device, motor.node_id, motor.counts_per_turn) == ("our-drive", 7, 16384.0)
    assert re.search(r"node_id = 7 +# >= 1, <= 126\n", text)


def test_a_package_is_imported_only_where_a_file_names_its_kind(installed, tmp_path):
    assert "our-drive" in list_motors()
    assert package_of("our-drive") == "our-drive 1.0"
    read_rig(ROOT / "calibration" / "twin.toml")
    with pytest.raises(BadInput, match="'device' should be one of"):
        read_rig(rig_with_section(tmp_path, RIG_SECTION.replace("our-drive", "another")))
    assert "our_drive" not in sys.modules
    assert isinstance(find_motor("our-drive"), MotorMake)
    assert "our_drive" in sys.modules
    assert "our_drive.twin" not in sys.modules


@pytest.mark.parametrize(
    ("point", "code", "said"),
    [
        (
            "broken_drive:DEVICE",
            "import no_such_thing",
            r"broken_drive:DEVICE cannot be loaded: ModuleNotFoundError: No module named ",
        ),
        (
            "broken_drive:DEVICE",
            "raise RuntimeError('two\\nlines')",
            r"broken_drive:DEVICE cannot be loaded: RuntimeError: two lines",
        ),
        (
            "broken_drive:OTHER",
            "DEVICE = 1",
            r"broken_drive:OTHER cannot be loaded: AttributeError: ",
        ),
        ("broken_drive:DEVICE", "DEVICE = 1", r"broken_drive:DEVICE is no MotorMake"),
        (
            "broken_drive:DEVICE",
            (
                "from rfca_rig.own import MotorMake\nDEVICE = "
                "MotorMake(section='broken_drive.no:Keys', twin='broken_drive:no')"
            ),
            r"broken_drive\.no:Keys cannot be loaded: ModuleNotFoundError: ",
        ),
    ],
)
def test_a_broken_package_is_named_and_disturbs_no_other_kind(
    site, tmp_path, monkeypatch, capsys, point, code, said
):
    (site / "broken_drive.py").write_text(code)
    state_package(site, "a-broken-drive", f"broken = {point}")
    rig = rig_with_section(tmp_path, RIG_SECTION.replace("our-drive", "broken"))
    refused = typed(
        monkeypatch,
        capsys,
        "dynamic",
        "run",
        "--rig",
        rig,
        "--height",
        "215",
        "--speed",
        "3.249",
        "--dry-run",
    )
    assert refused.exit_code == 2
    (line,) = refused.err.strip().splitlines()
    assert re.search(
        (
            r"rig\.toml:\d+: motor: device 'broken' of the installed package a-broken-drive "
            rf"1\.0: {said}"
        ),
        line,
    ), line
    assert read_rig(ROOT / "calibration" / "twin.toml").motor.device == "odrive"


def test_a_kind_that_two_packages_offer_is_refused(installed, rig):
    state_package(installed, "their-drive", "our-drive = our_drive:DEVICE")
    with pytest.raises(
        BadInput,
        match=(
            r"'our-drive' is offered by several installed packages: our-drive 1\.0, "
            r"their-drive 1\.0;"
        ),
    ):
        read_rig(rig)


def test_a_package_does_not_replace_a_built_in_kind(installed):
    state_package(installed, "their-odrive", "odrive = our_drive:DEVICE")
    assert find_motor("odrive").section.startswith("rfca_rig.devices.")
    assert list_motors() == (*MOTORS, "our-drive")


SENSOR_PAGE = (
    (ROOT / "docs" / "add-a-force-sensor.md")
    .read_text()
    .partition("## For several rigs: a package")[2]
    .partition("\n## ")[0]
)
(SENSOR_INIT,) = re.findall(r"(?s)```python\n(.*?)```", SENSOR_PAGE)
SENSOR_SECTION = (
    '[force_sensor]\ndevice = "our-sensor"\ncounts_per_N = 1e6\ncounts_per_Nm = 1e6\nrate_Hz '
    "= 800.0\n"
)


@pytest.fixture
def sensor_rig(site, tmp_path):
    """The shipped twin's file with the sensor of the package of docs/add-a-force-sensor.md."""
    sensor = (EXAMPLES / "our_sensor.py").read_text()
    for old, new in (
        ("ForceSensorKeys", "SerialSensorKeys"),
        ("    filter_length:", '    device: Literal["our-sensor"]\n    filter_length:'),
        ("\n\nFORCE_SENSOR = OurKeys\n", ""),
    ):
        assert old in sensor
        sensor = sensor.replace(old, new)
    inside = site / "our_sensor"
    inside.mkdir()
    (inside / "__init__.py").write_text(SENSOR_INIT)
    (inside / "sensor.py").write_text(sensor)
    (inside / "twin.py").write_text(
        (EXAMPLES / "our_sensor_twin.py").read_text().replace("\n\nTWIN = OurTwin\n", "")
    )
    state_package(site, "our-sensor", "our-sensor = our_sensor:DEVICE")
    text = (ROOT / "calibration" / "twin.toml").read_text()
    rig = tmp_path / "sensor-rig.toml"
    rig.write_text(
        re.sub(
            r"(?ms)^\[force_sensor\]\n.*?(?=^\[)",
            lambda _: f"{SENSOR_SECTION}\n",
            text.partition("[twin.camera]")[0],
        )
    )
    return rig


def test_a_sensor_of_a_package_streams_from_its_twin(sensor_rig):
    read = read_rig(sensor_rig)
    assert type(read.force_sensor).__module__ == "our_sensor.sensor"
    with open_bench(read, 1) as bench:
        assert judge_own_sensor(bench.sensor, bench.clock).colour is Colour.GREEN
    assert find_conformance_tests(read)[0].endswith("::TestOurForceSensor")
    assert packages_of(read.motor, read.force_sensor) == {"force_sensor_package": "our-sensor 1.0"}


@pytest.mark.slow
def test_a_sensor_of_a_package_keeps_the_contract(sensor_rig):
    assert run_conformance_tests(read_rig(sensor_rig), sensor_rig)


def test_the_doctor_names_the_kind_of_a_sensor(sensor_rig):
    keys = read_rig(sensor_rig).force_sensor.model_copy(update={"port": "/dev/not-there"})
    first, second = check_sensor(keys, TwinClock())
    assert first.seen == "our-sensor is loaded, its keys in [force_sensor] are right"
    assert second.seen.startswith("/dev/not-there cannot be opened")


def test_a_sensor_in_the_place_of_a_motor_is_refused(sensor_rig):
    text = sensor_rig.read_text()
    sensor_rig.write_text(
        re.sub(r"(?ms)^\[motor\]\n.*?(?=^\[)", '[motor]\ndevice = "our-sensor"\n\n', text)
    )
    with pytest.raises(
        BadInput,
        match=(
            r"motor: device 'our-sensor' of the installed package our-sensor 1\.0: .* is no "
            r"MotorMake"
        ),
    ):
        read_rig(sensor_rig)


@pytest.mark.slow
def test_an_installed_package_runs_from_its_rig_file_to_the_recording(tmp_path):
    source = tmp_path / "source"
    target = tmp_path / "target"
    write_package(source)
    (source / "pyproject.toml").write_text(BUILD_SYSTEM + PROJECT)
    (source / "backend.py").write_text(BACKEND)
    pip = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
        "--target",
        target,
        source,
    ]
    subprocess.run(pip, check=True, timeout=300)
    rig = rig_with_section(tmp_path)
    code = "import sys; from rfca_rig.cli.main import run; sys.argv[0] = 'rfca-rig'; run()"
    command = [
        sys.executable,
        "-c",
        code,
        "dynamic",
        "run",
        "--rig",
        rig,
        "--height",
        "215",
        "--speed",
        "3.249",
        "--repeats",
        "1",
    ]
    environment = {**os.environ, "PYTHONPATH": f"{target}{os.pathsep}{ROOT}"}
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=500,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    kept = read_recording(next((tmp_path / "runs").iterdir()) / "run.h5").provenance
    assert (kept["motor_make"], kept["motor_package"]) == (
        "CANopen drive, CiA 402",
        "our-drive 1.0",
    )
