"""From what the engine recorded to the form of a recording: one time base per device, zero at the commanded start."""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.channels import HINGES, SHAFT, UNITS, WRENCH
from rfca_rig.drivers.roles import ForceSamples, SensorScale, ShaftSamples
from rfca_rig.engine.stages import Recorded
from rfca_rig.engine.tap import host_offset_s
from rfca_rig.protocol.plan import Flap, Hold
from rfca_rig.recording.form import Column, StaticStage, Stream, Stroke
from rfca_rig.recording.run_file import RunFile

Floats = NDArray[np.float64]


class Recorder:
    """The engine's sink: each stage goes to disk before the next begins. Keeps the strokes and stages for the closing lines."""

    def __init__(self, file: RunFile, scale: SensorScale) -> None:
        self._file = file
        self._scale = scale
        self.strokes: list[Stroke] = []
        self.stages: list[StaticStage] = []

    def flap(self, stage: Flap, recorded: Recorded) -> None:
        stroke = stroke_of(stage, recorded, self._scale)
        self._file.add_stroke(stroke)
        self.strokes.append(stroke)

    def hold(self, stage: Hold, recorded: Recorded) -> None:
        static_stage = static_stage_of(stage, recorded, self._scale)
        self._file.add_static_stage(static_stage)
        self.stages.append(static_stage)


def stroke_of(stage: Flap, recorded: Recorded, scale: SensorScale) -> Stroke:
    """The stroke with raw counts, scale and both clocks of each device."""
    streams = {
        "shaft": _shaft_stream(recorded.shaft, recorded.start_s, recorded.turns_rad),
        "force": _force_stream(recorded.force, recorded.start_s, scale),
    }
    return Stroke(stage.height_m, stage.speed_rad_s, stage.repeat, streams)


def _shaft_stream(shaft: ShaftSamples, start_s: float, turns_rad: float) -> Stream:
    values = (shaft.angle_rad, shaft.speed_rad_s, shaft.torque_Nm)
    columns = {name: Column(raw, UNITS[name]) for name, raw in zip(SHAFT, values, strict=True)}
    columns["shaft_angle_rad"] = Column(shaft.angle_rad, UNITS["shaft_angle_rad"], offset=-turns_rad)
    return Stream(_device_time(shaft, start_s), columns | _clocks(shaft, start_s))


def _force_stream(force: ForceSamples, start_s: float, scale: SensorScale) -> Stream:
    columns = {
        name: Column(force.counts[:, axis], UNITS[name], 1.0 / (scale.counts_per_N if name.endswith("_N") else scale.counts_per_Nm))
        for axis, name in enumerate(WRENCH)
    }
    columns["rdt_sequence"] = Column(force.sequence, "")
    columns["status"] = Column(force.status, "")
    return Stream(_device_time(force, start_s), columns | _clocks(force, start_s))


def _device_time(samples: ShaftSamples | ForceSamples, start_s: float) -> Floats:
    return samples.device_s + (host_offset_s(samples.host_s, samples.device_s) - start_s)


def _clocks(samples: ShaftSamples | ForceSamples, start_s: float) -> dict[str, Column]:
    return {"host_s": Column(samples.host_s, "s", offset=-start_s), "device_s": Column(samples.device_s, "s")}


def static_stage_of(stage: Hold, recorded: Recorded, scale: SensorScale) -> StaticStage:
    """Means over the averaging time, with the standard deviation of a single sample; hinge angles wait for a camera."""
    counts = recorded.force.counts.astype(np.float64)
    wrench = dict(zip(WRENCH, (counts / _counts_per_unit(scale)).T, strict=True))
    angle_rad = recorded.shaft.angle_rad - recorded.turns_rad
    channels = {"shaft_angle_rad": angle_rad, "fy_N": wrench["fy_N"], "fz_N": wrench["fz_N"], "tx_Nm": wrench["tx_Nm"]}
    return StaticStage(
        height_m=stage.height_m,
        stage=stage.number,
        direction=stage.direction,
        shaft_angle_rad=float(angle_rad.mean()),
        hinge_deg=(np.nan,) * len(HINGES),
        fy_N=float(channels["fy_N"].mean()),
        fz_N=float(channels["fz_N"].mean()),
        tx_Nm=float(channels["tx_Nm"].mean()),
        std={name: float(values.std(ddof=1)) for name, values in channels.items()},
        settled=recorded.settled,
    )


def _counts_per_unit(scale: SensorScale) -> Floats:
    return np.repeat([scale.counts_per_N, scale.counts_per_Nm], 3)
