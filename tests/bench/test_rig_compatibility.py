"""A run goes on only with the curve, the calibration and the devices that it began with."""

from types import SimpleNamespace

import pytest

from rfca_rig.bench.rig_compatibility import (
    Change,
    changes_of_event,
    check_camera_file,
    compare_devices,
    compare_software,
    read_compatible_rig,
)
from rfca_rig.description.rig_file import read_rig
from rfca_rig.errors import BadInput
from tests.description.test_torque_rotation import CSV, TWIN
from tests.engine.rigs import ROOT

CURVE = '[leg.torque_rotation]\ncurve = "measured.csv"\n\n[ground]'


@pytest.fixture
def rig(tmp_path):
    (tmp_path / "measured.csv").write_text(CSV, encoding="utf-8")
    plain = "".join(
        line
        for line in TWIN.splitlines(keepends=True)
        if not line.startswith(("hinge_torque_Nm", "k0_", "k2_"))
    )
    (tmp_path / "rig.toml").write_text(plain.replace("[ground]", CURVE, 1), encoding="utf-8")
    return tmp_path / "rig.toml"


def begun_with(rig, **more):
    header = SimpleNamespace(
        provenance={"rig_file": rig.read_text(encoding="utf-8"), **more},
        nominal=read_rig(rig).nominal(),
    )
    return SimpleNamespace(header=header, folder=rig.parent)


def test_a_curve_that_reads_otherwise_is_refused_by_its_key(rig):
    begun = begun_with(rig)
    assert read_compatible_rig(begun, rig, deliberately=False).changes == {}
    (rig.parent / "measured.csv").write_text(CSV.replace("1.67", "1.70"), encoding="utf-8")
    with pytest.raises(
        BadInput,
        match=r"leg\.torque_rotation\.curve has changed; one run has one nominal model",
    ):
        read_compatible_rig(begun, rig, deliberately=True)


def test_a_run_with_a_model_file_does_not_ask_for_the_curve(rig):
    begun = begun_with(rig, model_file="the values of another file")
    (rig.parent / "measured.csv").write_text(CSV.replace("1.67", "1.70"), encoding="utf-8")
    assert read_compatible_rig(begun, rig, deliberately=False).changes == {}


CAMERA = (ROOT / "calibration" / "twin-camera.toml").read_text(encoding="utf-8")


@pytest.fixture
def photographed(tmp_path):
    """A rig with a camera, and a run that began with it."""
    (tmp_path / "twin-camera.toml").write_text(CAMERA, encoding="utf-8")
    (tmp_path / "rig.toml").write_text(TWIN, encoding="utf-8")
    return tmp_path / "rig.toml", begun_with(tmp_path / "rig.toml", camera_file=CAMERA)


def with_line(key, value):
    """The camera file with another value of the first such key."""
    lines = CAMERA.splitlines(keepends=True)
    at = next(number for number, line in enumerate(lines) if line.startswith(f"{key} ="))
    return "".join([*lines[:at], f"{key} = {value}\n", *lines[at + 1 :]])


@pytest.mark.parametrize(
    ("key", "value", "named"),
    [
        ("focal_px", "[2100.0, 2100.0]", r"camera\.focal_px is \[2100\.0, 2100\.0\] and was \["),
        ("translation_mm", "[1.0, 2.0, 900.0]", r"plane\.translation_mm is \[1\.0, 2\.0, 900\.0\]"),
    ],
)
def test_a_camera_that_was_calibrated_or_placed_anew_is_refused(photographed, key, value, named):
    path, begun = photographed
    rig = read_rig(path)
    assert check_camera_file(begun, rig) == {}
    (path.parent / "twin-camera.toml").write_text(with_line(key, value), encoding="utf-8")
    with pytest.raises(BadInput, match=named) as refused:
        check_camera_file(begun, rig)
    assert "photos of a run are read with one calibration: put the file back" in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_how_a_camera_was_calibrated_is_noted_and_so_is_a_file_that_is_gone(photographed):
    path, begun = photographed
    rig = read_rig(path)
    camera = path.parent / "twin-camera.toml"
    camera.write_text(with_line("origin_from", '"a ruler"'), encoding="utf-8")
    noted = check_camera_file(begun, rig)
    assert list(noted) == ["plane.origin_from"] and noted["plane.origin_from"].now == "a ruler"
    camera.write_text(CAMERA + "# another word\n", encoding="utf-8")
    assert check_camera_file(begun, rig) == {}
    camera.unlink()
    assert check_camera_file(begun, rig)["camera.calibration_file"].now == "gone"


def test_a_calibration_that_was_given_in_place_of_the_rig_s_is_found_again(photographed):
    path, _ = photographed
    other = path.parent / "other.toml"
    other.write_text(with_line("focal_px", "[2100.0, 2100.0]"), encoding="utf-8")
    stored = {"camera_file": other.read_text(encoding="utf-8"), "calibration_file": str(other)}
    begun = begun_with(path, **stored)
    assert check_camera_file(begun, read_rig(path)) == {}
    other.write_text(CAMERA, encoding="utf-8")
    with pytest.raises(BadInput, match=r"other\.toml: camera\.focal_px is "):
        check_camera_file(begun, read_rig(path))


DEVICES = {
    "motor_make": "moteus, multiplex protocol on CAN-FD",
    "motor_serial_number": "0123456789abcdef01234567",
    "motor_firmware": "0.3.2",
    "motor_gear_ratio": "9.0",
    "motor_answers_lost": "3",
    "sensor_serial_number": "FT-31415",
    "sensor_counts_per_N": "1000000.0",
    "sensor_rate_Hz": "7000",
    "camera": "OpenCV camera 0",
    "camera_size_px": "1920 x 1080",
}


def compared(deliberately=False, before=DEVICES, **now):
    begun = SimpleNamespace(devices=before, folder="runs/REAL-a-001")
    return compare_devices(begun, {**DEVICES, **now}, "rig.toml", deliberately)


@pytest.mark.parametrize(
    ("key", "now"),
    [
        ("motor_make", "ODrive, CANSimple"),
        ("motor_serial_number", "ffff00000000000000000000"),
        ("motor_gear_ratio", "6.0"),
        ("sensor_serial_number", "FT-27182"),
        ("sensor_counts_per_N", "500000.0"),
        ("sensor_rate_Hz", "3500"),
        ("camera_size_px", "1280 x 720"),
    ],
)
def test_another_device_is_refused_with_both_values_unless_it_is_meant(key, now):
    with pytest.raises(BadInput) as refused:
        compared(**{key: now})
    assert str(refused.value) == (
        f"runs/REAL-a-001: {key} is {now} and was {DEVICES[key]}; to go on with this device, say "
        "--rig rig.toml"
    )
    changes, noted = compared(deliberately=True, **{key: now})
    assert changes == {key: Change(DEVICES[key], now)} and noted == {}


def test_firmware_and_address_are_noted_and_counters_are_not():
    changes, noted = compared(
        motor_firmware="0.4.0", camera="OpenCV camera 1", motor_answers_lost="0"
    )
    assert changes == {} and set(noted) == {"motor_firmware", "camera"}
    assert changes_of_event(changes, noted) == {
        "noted": {
            "motor_firmware": {"before": "0.3.2", "now": "0.4.0"},
            "camera": {"before": "OpenCV camera 0", "now": "OpenCV camera 1"},
        }
    }


@pytest.mark.parametrize("unknown", ["", "unknown", "unknownunknownunknown"])
def test_what_one_side_does_not_know_is_not_compared(unknown):
    key = "motor_serial_number"
    assert compared(**{key: unknown}) == ({}, {})
    assert compared(before={**DEVICES, key: unknown}) == ({}, {})
    assert compared(before={}) == ({}, {})


def test_software_is_noted():
    header = SimpleNamespace(provenance={"rfca_rig_version": "1.0.0", "host": "rig"})
    begun = SimpleNamespace(header=header)
    present = {"rfca_rig_version": "1.1.0", "host": "rig", "numpy_version": "2.0"}
    assert compare_software(begun, present) == {"rfca_rig_version": Change("1.0.0", "1.1.0")}


def test_a_long_value_is_not_printed(rig):
    begun = begun_with(rig)
    text = rig.read_text(encoding="utf-8")
    assert 'title = "' in text
    title = next(line for line in text.splitlines() if line.startswith("title = "))
    rig.write_text(text.replace(title, f'title = "{"long " * 30}"'), encoding="utf-8")
    with pytest.raises(BadInput, match=r"rig\.title has changed; to go on with it, say --rig"):
        read_compatible_rig(begun, rig, deliberately=False)
