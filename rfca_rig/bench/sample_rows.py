"""The columns in which motor and sensor are recorded: raw, with the scale to their units and both clocks."""

import numpy as np

from rfca_rig.channels import SHAFT, UNITS, WRENCH
from rfca_rig.drivers.roles import ForceSamples, SensorScale, ShaftSamples
from rfca_rig.recording.rows import DEVICE_TIME, HOST_TIME, ColumnForm, Rows, Start, StreamForm

_CLOCKS = (ColumnForm(HOST_TIME, "<f8", "s"), ColumnForm(DEVICE_TIME, "<f8", "s"))

SHAFT_FORM = StreamForm("shaft", (*(ColumnForm(name, "<f8", UNITS[name]) for name in SHAFT), *_CLOCKS))
_SHAFT_DTYPE = SHAFT_FORM.dtype


def force_form(scale: SensorScale) -> StreamForm:
    """Counts, with what makes them newtons and newton metres."""
    per_unit = {"N": scale.counts_per_N, "Nm": scale.counts_per_Nm}
    wrench = (ColumnForm(name, "<i4", UNITS[name], 1.0 / per_unit[name.split("_")[1]]) for name in WRENCH)
    return StreamForm("force", (*wrench, ColumnForm("rdt_sequence", "<i8", ""), ColumnForm("status", "<u4", ""), *_CLOCKS))


_FORCE_DTYPE = force_form(SensorScale(1.0, 1.0, 1.0)).dtype


def shaft_rows(samples: ShaftSamples) -> Rows:
    """As `SHAFT_FORM` says."""
    rows = np.empty(len(samples.host_s), _SHAFT_DTYPE)
    for name, values in zip(SHAFT, (samples.angle_rad, samples.speed_rad_s, samples.torque_Nm), strict=True):
        rows[name] = values
    rows[HOST_TIME], rows[DEVICE_TIME] = samples.host_s, samples.device_s
    return rows


def force_rows(samples: ForceSamples) -> Rows:
    """As `force_form` says."""
    rows = np.empty(len(samples.host_s), _FORCE_DTYPE)
    for axis, name in enumerate(WRENCH):
        rows[name] = samples.counts[:, axis]
    rows["rdt_sequence"], rows["status"] = samples.sequence, samples.status
    rows[HOST_TIME], rows[DEVICE_TIME] = samples.host_s, samples.device_s
    return rows


def commanded_start(start_s: float, turns_rad: float) -> Start:
    """What makes the host's time zero at the start, and brings the shaft within one turn of the stage's own angles."""
    return Start(start_s, {"shaft_angle_rad": -turns_rad, HOST_TIME: -start_s})
