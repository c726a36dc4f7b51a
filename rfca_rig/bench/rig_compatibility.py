"""Compares the present rig with that of an interrupted run: rig file, camera calibration, devices,
software.

A difference that changes what the recorded numbers mean is refused, with its key, its new value and
the one before. Most of them can be meant: `--rig FILE` then records them. The nominal model and the
camera's calibration cannot: one recording has one of each. What else differs is noted in the run's
events.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rfca_rig.bench.resume import InterruptedRun
from rfca_rig.description.camera_file import CameraFile
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.devices.own import packages_of, texts_of
from rfca_rig.errors import BadInput
from rfca_rig.toml import model_of, read_text

NOMINAL_SECTIONS = ("leg", "ground", "sensor", "drive", "effects", "known_to")
# All analyses use one nominal model per recording, so these values may not change within a run.
FIXED = (*(f"{section}." for section in NOMINAL_SECTIONS), "rig.kind")
# A later check of the sensor is no other model.
NOT_FIXED = "sensor.checked"

# Key of the recording for a calibration that was given in place of the rig file's.
CALIBRATION_KEY = "calibration_file"
# Parts of a camera file that say how it was made, and do not change how a photo is read.
HOW_CALIBRATED = ("photos", "refused", "camera.board", "plane.photo", "plane.origin_from")

# What a device reports of itself, by the key without "motor_" or "sensor_". The first decide what
# its numbers mean, or which device it is; the others do not. Counters, temperatures and the like
# are in neither.
MEANING = (
    "make",
    "model",
    "serial_number",
    "calibration_date",
    "matrix_SI_per_V",
    "counts_per_N",
    "counts_per_Nm",
    "rate_Hz",
    "card_range_V",
    "gear_ratio",
    "direction",
    "zero_turns",
    "zero_rad",
    "zero_deg",
    "pole_pairs",
    "torque_constant_Nm_per_A",
    "torque_from",
    "dialect",
    "size_px",
)
HARMLESS = (
    "firmware",
    "bus",
    "address",
    "node_id",
    "drive_id",
    "card",
    # Measured anew by each run.
    "unloaded_V",
    "watchdog_s",
    "speed_gain_Nm_s_per_rad",
    "angle_gain_per_s",
    "encoder_period_s",
    "status_period_s",
)
SOFTWARE = (
    "rfca_rig_version",
    "git_revision",
    "git_dirty",
    "python_version",
    "numpy_version",
    "h5py_version",
    "hdf5_version",
    "host",
    "operating_system",
)
# Longer values, such as the text of a driver, are not printed.
LONGEST_VALUE = 60
MOST_NAMED = 4
GONE = "gone"


@dataclass(frozen=True)
class Change:
    """The value as the run had it, and as it is now, as text."""

    before: str
    now: str


Noted = Mapping[str, Change]


@dataclass(frozen=True)
class PresentRig:
    """The present rig file, and its changes since the run began, by key."""

    rig: RigFile
    text: str
    changes: Mapping[str, Change] = field(default_factory=dict)


def read_compatible_rig(begun: InterruptedRun, path: Path, deliberately: bool) -> PresentRig:
    """The rig file in `path`. Raises BadInput, naming the keys, where it differs from the run's and
    `deliberately` is False.

    The nominal model of leg and surroundings may never change within a run: one recording has one
    nominal model.
    """
    now = read_rig(path)
    text = read_text(path)
    before = model_of(begun.header.provenance["rig_file"], RigFile, begun.folder / "rig_file")
    # A lab's driver or a curve may change while the rig file that names it stays the same. Compared
    # as validated models, so that comments, order and defaults of the text make no difference.
    changes = {
        **_differences(before, model_of(text, RigFile, path)),
        **_other_drivers(begun, now),
        **_other_curve(begun, before, now),
    }
    fixed = {
        key: change
        for key, change in changes.items()
        if key.startswith(FIXED) and not key.startswith(NOT_FIXED)
    }
    if fixed:
        raise BadInput(
            f"{path}: {_describe(fixed)}; one run has one nominal model, so begin a new run"
        )
    if changes and not deliberately:
        raise BadInput(f"{path}: {_describe(changes)}; to go on with it, say --rig {path}")
    return PresentRig(now, text, changes)


def check_camera_file(begun: InterruptedRun, rig: RigFile) -> Noted:
    """Compares the camera's calibration with the one that the run reads its photos with. Returns
    differences that change no photo.

    Raises BadInput where the camera was calibrated, or placed, differently since: all photos of a
    run are read with one calibration.
    """
    stored = begun.header.provenance
    if "camera_file" not in stored or rig.camera is None:
        return {}
    path = Path(stored.get(CALIBRATION_KEY, rig.camera.calibration_file))
    if not path.is_file():
        return {"camera.calibration_file": Change(str(path), GONE)}
    before = model_of(stored["camera_file"], CameraFile, begun.folder / "camera_file")
    changes = _differences(before, model_of(read_text(path), CameraFile, path))
    noted = {key: change for key, change in changes.items() if key.startswith(HOW_CALIBRATED)}
    moved = {key: change for key, change in changes.items() if key not in noted}
    if moved:
        raise BadInput(
            f"{path}: {_describe(moved)}; the photos of a run are read with one calibration: put "
            "the file back, or begin a new run"
        )
    return noted


def compare_devices(
    begun: InterruptedRun, present: Mapping[str, str], rig: str, deliberately: bool
) -> tuple[Mapping[str, Change], Noted]:
    """Compares what the devices report of themselves with what those of the run did.

    Parameters
    ----------
    begun
        The run.
    present
        Facts by key, as `provenance.devices` gives them. What either side does not know is not
        compared.
    rig
        The rig file, for the message.
    deliberately
        Whether differences that change the meaning of the data are accepted.

    Returns
    -------
    tuple
        Differences that were accepted, and harmless ones.

    Raises
    ------
    BadInput
        Naming keys with new and earlier values, where differences are not accepted.
    """
    changes = {}
    noted = {}
    for key, now in present.items():
        change = Change(begun.devices.get(key, ""), now)
        if change.before == change.now or not (_is_known(change.before) and _is_known(now)):
            continue
        fact = key.partition("_")[2]
        if fact in MEANING:
            changes[key] = change
        elif fact in HARMLESS or key == "camera":
            noted[key] = change
    if changes and not deliberately:
        raise BadInput(
            f"{begun.folder}: {_describe(changes)}; to go on with this device, say --rig {rig}"
        )
    return changes, noted


def compare_software(begun: InterruptedRun, present: Mapping[str, str]) -> Noted:
    """Versions and machine that are not those of the run's beginning. The formats of files are
    checked where files are read, so that no version is refused here.
    """
    stored = begun.header.provenance
    return {
        key: Change(stored[key], present[key])
        for key in SOFTWARE
        if key in stored and key in present and stored[key] != present[key]
    }


def changes_of_event(
    changes: Mapping[str, Change], noted: Noted
) -> Mapping[str, Mapping[str, object]]:
    """For the event of the continuation: new values of what was changed deliberately, and both
    values of the rest.
    """
    event: dict[str, Mapping[str, object]] = {}
    if changes:
        event["rig_changes"] = {name: change.now for name, change in changes.items()}
    if noted:
        event["noted"] = {
            name: {"before": change.before, "now": change.now} for name, change in noted.items()
        }
    return event


def _is_known(fact: str) -> bool:
    return bool(fact) and "unknown" not in fact


def _differences(before: RigFile | CameraFile, now: RigFile | CameraFile) -> dict[str, Change]:
    """Values that differ, by their dotted keys."""
    old, new = (dict(_flat(part.model_dump(mode="json"), "")) for part in (before, now))
    return {
        key: Change(str(old.get(key, "not there")), str(new.get(key, GONE)))
        for key in sorted({*old, *new})
        if old.get(key) != new.get(key)
    }


def _describe(changes: Mapping[str, Change]) -> str:
    """Such as "motor.node_id is 3 and was 0, limits.force_N is 200.0 and was 300.0"."""
    parts = [_describe_change(key, change) for key, change in changes.items()]
    shown = ", ".join(parts[:MOST_NAMED])
    if len(parts) > MOST_NAMED:
        shown += f" and {len(parts) - MOST_NAMED} more"
    return shown


def _describe_change(key: str, change: Change) -> str:
    if _is_short([change.before, change.now]):
        return f"{key} is {change.now} and was {change.before}"
    return f"{key} has changed"


def _is_short(texts: Iterable[str]) -> bool:
    return all(len(text) <= LONGEST_VALUE and "\n" not in text for text in texts)


def _other_drivers(begun: InterruptedRun, now: RigFile) -> dict[str, Change]:
    """Files of a lab's own devices whose text has changed, and an installed package whose
    version has.
    """
    before = begun.header.provenance
    present = {**texts_of(now.motor, now.force_sensor), **packages_of(now.motor, now.force_sensor)}
    return {
        name: Change(before[name], text)
        for name, text in present.items()
        if before.get(name, text) != text
    }


def _other_curve(begun: InterruptedRun, before: RigFile, now: RigFile) -> dict[str, Change]:
    """The file of a torque-rotation curve, if its values have changed. A run with a model file
    does not use the rig file's curve.
    """
    section = before.leg.torque_rotation
    if section is None or section.curve is None or "model_file" in begun.header.provenance:
        return {}
    old, new = (
        model["leg"].get("torque_rotation") for model in (begun.header.nominal, now.nominal())
    )
    if old == new:
        return {}
    return {"leg.torque_rotation.curve": Change(str(old), str(new))}


def _flat(values: Mapping[str, Any], above: str) -> list[tuple[str, Any]]:
    pairs: list[tuple[str, Any]] = []
    for key, value in values.items():
        name = f"{above}{key}"
        if isinstance(value, dict):
            pairs += _flat(value, f"{name}.")
        else:
            pairs.append((name, value))
    return pairs
