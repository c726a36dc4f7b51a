"""Compares the rig file of a continued run with the one that it began with, key by key."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rfca_rig.bench.begun import InterruptedRun
from rfca_rig.description.own_devices import texts_of
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.description.toml import model_of, read_text
from rfca_rig.errors import BadInput

NOMINAL_SECTIONS = ("leg", "ground", "sensor", "drive", "effects", "known_to")
# All analyses use one nominal model per recording, so these values may not change within a run.
FIXED = (*(f"{section}." for section in NOMINAL_SECTIONS), "rig.kind")


@dataclass(frozen=True)
class PresentRig:
    """The present rig file, and its changes since the run began: the new value by key, as text."""

    rig: RigFile
    text: str
    changes: Mapping[str, str] = field(default_factory=dict)


def read_compatible_rig(begun: InterruptedRun, path: Path, deliberately: bool) -> PresentRig:
    """The rig file in `path`. Raises BadInput, naming the keys, where it differs from the run's and `deliberately` is False.

    The nominal model of leg and surroundings may never change within a run: one recording has one nominal model.
    """
    now, text = read_rig(path), read_text(path)
    before = model_of(begun.header.provenance["rig_file"], RigFile, begun.folder / "rig_file")
    # A lab's driver or a curve may change while the rig file that names it stays the same.
    changes = {**_changes(before, model_of(text, RigFile, path)), **_other_drivers(begun, now), **_other_curve(begun, before, now)}
    fixed = [key for key in changes if key.startswith(FIXED)]
    if fixed:
        raise BadInput(f"{path}: {_list_keys(fixed)} not as the run began with; one run has one belief, so begin a new one")
    if changes and not deliberately:
        raise BadInput(f"{path}: {_list_keys(list(changes))} not as the run began with; to go on with it as it stands, say --rig {path}")
    return PresentRig(now, text, changes)


def _list_keys(keys: list[str]) -> str:
    shown = ", ".join(keys[:4]) + (f" and {len(keys) - 4} more" if len(keys) > 4 else "")
    return f"{shown} {'is' if len(keys) == 1 else 'are'}"


def _changes(before: RigFile, now: RigFile) -> dict[str, str]:
    # Compared as validated models, so that comments, order and defaults of the text make no difference.
    old, new = (dict(_flat(rig.model_dump(mode="json"), "")) for rig in (before, now))
    return {key: str(new.get(key, "gone")) for key in sorted({*old, *new}) if old.get(key) != new.get(key)}


def _other_drivers(begun: InterruptedRun, now: RigFile) -> dict[str, str]:
    """Files of a lab's own devices whose text has changed, with the present text."""
    before = begun.header.provenance
    return {name: text for name, text in texts_of(now.motor, now.force_sensor).items() if before.get(name, text) != text}


def _other_curve(begun: InterruptedRun, before: RigFile, now: RigFile) -> dict[str, str]:
    """The file of a torque-rotation curve, if its values have changed. A run with a model file does not use the rig file's curve."""
    section = before.leg.torque_rotation
    if section is None or section.curve is None or "model_file" in begun.header.provenance:
        return {}
    old, new = (model["leg"].get("torque_rotation") for model in (begun.header.nominal, now.nominal()))
    return {} if old == new else {"leg.torque_rotation.curve": section.curve}


def _flat(values: Mapping[str, Any], above: str) -> list[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    for key, value in values.items():
        name = f"{above}{key}"
        found += _flat(value, f"{name}.") if isinstance(value, dict) else [(name, value)]
    return found
