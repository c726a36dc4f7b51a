"""Predictions of one stroke for planning: valley, peak force, peak shaft torque, touchdown."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rfca_rig.analysis.phases import Valley, find_valley
from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import SimulatedStroke, simulate_stroke_at_speed

# Samples of the prediction, and how much of the rest before the start is shown.
SAMPLE_S = 1e-3
BEFORE_S = 0.1


@dataclass(frozen=True)
class Prediction:
    """One predicted stroke with its height and speed."""

    height_m: float
    speed_rad_s: float
    stroke: SimulatedStroke

    def summary(self) -> dict[str, float | str | None]:
        """The figures by name, each with its unit; `no_valley` says why there is none."""
        stroke = self.stroke
        valley = find_valley(stroke.t_s, stroke.fz_N)
        valley_time_s = None
        valley_fz_N = None
        no_valley = None
        if isinstance(valley, Valley):
            valley_time_s = round(valley.time_s, 5)
            valley_fz_N = round(valley.fz_N, 4)
        else:
            no_valley = valley.reason
        force = np.hypot(stroke.fy_N, stroke.fz_N)
        touching = stroke.normal_N.sum(axis=1) > 0.0
        touches_from_s = None
        if touching.any():
            touches_from_s = round(float(stroke.t_s[touching.argmax()]), 4)
        return {
            "height_mm": round(1e3 * self.height_m, 6),
            "speed_rad_s": self.speed_rad_s,
            "valley_time_s": valley_time_s,
            "valley_fz_N": valley_fz_N,
            "no_valley": no_valley,
            "peak_force_N": round(float(force.max()), 3),
            "peak_force_time_s": round(float(stroke.t_s[force.argmax()]), 4),
            "peak_shaft_torque_Nm": round(float(np.abs(stroke.shaft_torque_Nm).max()), 4),
            "touches_from_s": touches_from_s,
        }

    def lines(self) -> list[str]:
        """The same figures as lines for a terminal."""
        figures = self.summary()
        if figures["no_valley"]:
            valley = f"no valley: {figures['no_valley']}"
        else:
            valley = (
                f"valley at {figures['valley_time_s']:.3f} s, fz {figures['valley_fz_N']:.2f} N"
            )
        if figures["touches_from_s"] is None:
            touch = "never touches the ground"
        else:
            touch = f"touches from {figures['touches_from_s']:.3f} s"
        return [
            f"{figures['height_mm']:g} mm, {self.speed_rad_s:g} rad/s: {touch}, {valley}",
            f"peak force {figures['peak_force_N']:.1f} N at {figures['peak_force_time_s']:.3f} s, "
            f"peak shaft torque {figures['peak_shaft_torque_Nm']:.2f} N m",
        ]


def predict_stroke(
    rig: RigModel, height_m: float, speed_rad_s: float, sweep_deg: float
) -> Prediction:
    """Predict a stroke from the start angle over `sweep_deg` at constant speed, sampled at 1
    kHz.
    """
    # The ramp covers half the angle of a turn at full speed, so the sweep takes half a ramp longer.
    end_s = float(np.radians(sweep_deg)) / speed_rad_s + 0.5 * rig.drive.ramp_s
    t_s = (
        np.arange(-round(BEFORE_S / SAMPLE_S), max(int(end_s / SAMPLE_S), 1) + 1, dtype=np.float64)
        * SAMPLE_S
    )
    return Prediction(
        height_m, speed_rad_s, simulate_stroke_at_speed(rig, height_m, speed_rad_s, t_s)
    )


def write_csv(stroke: SimulatedStroke, path: Path) -> None:
    """Write the stroke with the column names of a campaign's dynamic CSV, so that it can be
    imported as a campaign.
    """
    names = "t_s,shaft_angle_rad,motor_torque_Nm,fy_N,fz_N,tx_Nm"
    columns = [
        stroke.t_s,
        stroke.shaft_angle_rad,
        stroke.shaft_torque_Nm,
        stroke.fy_N,
        stroke.fz_N,
        stroke.tx_Nm,
    ]
    try:
        np.savetxt(
            path, np.column_stack(columns), fmt="%.6g", delimiter=",", header=names, comments=""
        )
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror}") from None
