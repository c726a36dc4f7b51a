"""Export of a leg's strokes as an experiment on a mechanism: the leg as MJCF, experiment.toml, and
a CSV file per stroke.

The rack's height and the shaft's motion are prescribed. Where the drive tracks its command, the
motion is the commanded one from the measured start. Otherwise it is the mean of the measured
motions, as in the diagnosis of the leg.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.scatter import USUAL_SCATTER
from rfca_rig.analysis.phases import Undetermined, valley_and_phases
from rfca_rig.analysis.repeats import group_by_condition
from rfca_rig.campaign.opening import open_with_nominal_model
from rfca_rig.diagnosis.leg.prepared import PreparedLeg, prepare_leg
from rfca_rig.diagnosis.leg.simulator import SWING_RATE_STD_PER_S, SWING_SHARE_STD
from rfca_rig.diagnosis.leg.strokes import DynamicCondition
from rfca_rig.errors import BadInput
from rfca_rig.escaping import toml_comment
from rfca_rig.mechanism.model_files import (
    FLOOR,
    RACK,
    SENSOR,
    SHAFT,
    end_names,
    hinge_names,
    link_names,
    write_leg_mjcf,
)
from rfca_rig.model.parameters import RigModel
from rfca_rig.recording.atomic import make_folder_atomically, translate_os_errors
from rfca_rig.recording.model import Recording, Stroke
from rfca_rig.toml import format_value

Floats = NDArray[np.float64]

MODEL = "leg.xml"
SENSORS = {
    "fy_N": (f"{SENSOR}_force_y", "N"),
    "fz_N": (f"{SENSOR}_force_z", "N"),
    "tx_Nm": (f"{SENSOR}_torque_x", "N m"),
}
# Prior standard deviation, as a share, of the floor's damping, presliding and drag, which rig files
# do not state. The same as for the leg.
SELDOM_MEASURED = 0.5


@dataclass(frozen=True)
class ExportedLeg:
    """Number of recordings in the folder, and in words what the export could not represent."""

    recordings: int
    left_out: tuple[str, ...]


def export_leg(run: Path, out: Path, allow_outside: bool = False) -> ExportedLeg:
    """Writes the folder `out`, completely or not at all.

    Parameters
    ----------
    run
        A campaign, or another recording of strokes of a leg.
    out
        The folder to make.
    allow_outside
        Follow links of a campaign to files outside its folder.

    Raises
    ------
    BadInput
        Where `out` is there already, `run` is no recording of a leg, or none of its strokes shows a
        valley.
    RigError
        When the disk refuses.
    """
    if out.exists():
        raise BadInput(
            f"{out}: is there already; name a folder that does not exist yet, or take this one away"
        )
    recordings = open_with_nominal_model([run], allow_outside=allow_outside)
    prepared = prepare_leg(recordings)
    if not prepared.flaps:
        raise BadInput(
            f"{run}: no stroke shows a touchdown and a valley, so there is no motion to export"
        )
    files = _Files(prepared, recordings)
    with translate_os_errors(out, "cannot be written"):
        make_folder_atomically(out, files.write)
    return ExportedLeg(
        len(files.strokes), tuple(_describe_left_out(prepared.rig, recordings, prepared))
    )


class _Files:
    """Content of the exported folder."""

    def __init__(self, prepared: PreparedLeg, recordings: Sequence[Recording]) -> None:
        flaps = {flap.label: flap for flap in prepared.flaps}
        conditions = group_by_condition(
            stroke for recording in recordings for stroke in recording.strokes
        )
        self.prepared = prepared
        self.strokes = [
            (flaps[condition.label], stroke)
            for condition in conditions
            if condition.label in flaps
            for stroke in condition.strokes
            if _shows_valley(stroke)
        ]
        # One list of signals for all recordings: a channel that a single condition lacks is
        # exported for none.
        common = set(SENSORS).intersection(*(flap.signals for flap in prepared.flaps))
        self.signals = tuple(name for name in SENSORS if name in common)

    def write(self, folder: Path) -> None:
        (folder / MODEL).write_text(write_leg_mjcf(self.prepared.rig), encoding="utf-8")
        entries = ""
        repeats = dict.fromkeys((flap.label for flap, _ in self.strokes), 0)
        for number, (flap, stroke) in enumerate(self.strokes, start=1):
            name = f"stroke-{number:02d}.csv"
            (folder / name).write_text(self._csv(flap, stroke), encoding="utf-8")
            repeats[flap.label] += 1
            # The file holds the whole stroke; from_s and to_s mark the stretch that the diagnosis
            # of the leg compares.
            begin_s = float(flap.t_s[0])
            end_s = float(flap.t_s[-1])
            entries += (
                f"\n[[recordings]]\nfile = {format_value(name)}\ncondition = "
                f"{format_value(flap.label)}\nrepeat = {repeats[flap.label]}\n"
            )
            entries += f"from_s = {format_value(begin_s)}\nto_s = {format_value(end_s)}\n"
        (folder / "experiment.toml").write_text(self._description() + entries, encoding="utf-8")

    def _csv(self, flap: DynamicCondition, stroke: Stroke) -> str:
        at_s = np.asarray(stroke.channel("fz_N")[0])  # type: ignore[index]
        motion = flap.turn.motion(
            self.prepared.coordinates.supposed(np.zeros(self.prepared.coordinates.size)),
            float(at_s[-1]),
        )
        # The motion is defined between its first and last break only: outside, the shaft stands at
        # the end.
        angle_rad = motion.angle_rad(np.clip(at_s, motion.breaks_s[0], motion.breaks_s[-1]))
        forces = [np.interp(at_s, *stroke.channel(name)) for name in self.signals]  # type: ignore[misc]
        rows = np.column_stack([at_s, np.full(len(at_s), 1e3 * flap.height_m), angle_rad, *forces])
        text = StringIO()
        np.savetxt(
            text,
            rows,
            delimiter=",",
            header=",".join(("t_s", "height_mm", "shaft_rad", *self.signals)),
            comments="",
            fmt="%.9g",
        )
        return text.getvalue()

    def _description(self) -> str:
        prepared = self.prepared
        leg = self.prepared.rig.leg
        ground = self.prepared.rig.ground
        text = toml_comment(
            f"{prepared.title}: the leg as a mechanism. Its force sensor counts the other "
            "way round than MuJoCo's."
        )
        text += (
            f'format = "rfca-experiment/1"\ntitle = {format_value(prepared.title)}\nmodel = '
            f"{format_value(MODEL)}\n"
        )
        text += (
            '\n[time]\ncolumn = "t_s"\nunit = "s"\n\n[start]\nstate = "at '
            'rest"\n\n[windows]\nbin_s = 0.02\n'
        )
        for name in self.signals:
            sensor, unit = SENSORS[name]
            # sign = -1: the leg's force sensor counts the other way round than MuJoCo's.
            text += (
                f"\n[[signals]]\nsensor = {format_value(sensor)}\ncolumn = "
                f"{format_value(name)}\nunit = {format_value(unit)}\nsign = -1\n"
            )
            if noise := prepared.noise_std.get(name):
                text += f"noise_std = {format_value(noise)}\n"
        text += (
            f'\n[[prescribed]]\njoint = "{RACK}"\ncolumn = "height_mm"\nunit = '
            f'"mm"\nscatter_std = {USUAL_SCATTER["height"]}\n'
        )
        # smoothed_s = 0: the motion is computed, not measured, and carries no noise.
        text += (
            f'\n[[prescribed]]\njoint = "{SHAFT}"\ncolumn = "shaft_rad"\nunit = '
            '"rad"\nsmoothed_s = 0.0\n'
        )
        law = {
            "spheres": end_names(leg),
            "plane": FLOOR,
            "stiffness_N_per_m1p5": ground.stiffness_N_per_m1p5,
            "damping_s_per_m": ground.damping_s_per_m,
            "friction": ground.friction_coefficient,
            "presliding_mm": 1e3 * ground.presliding_m,
            "drag_N_s_per_m": ground.drag_N_s_per_m,
        }
        text += "\n[[contacts]]\n" + "".join(
            f"{key} = {format_value(value)}\n" for key, value in law.items()
        )
        text += (
            f"\n[alike]\nhinges = {format_value(hinge_names(leg))}\nlinks = "
            f"{format_value(link_names(leg))}\n"
        )
        text += "\n[known_to]\n" + "".join(
            f"{key} = {format_value(std)}\n"
            for key, std in _priors(prepared.rig, prepared.known_to).items()
        )
        return text


def _priors(rig: RigModel, known_to: Mapping[str, float]) -> dict[str, float]:
    """Prior standard deviations ([known_to]) of the leg under the names that a mechanism has for
    them.
    """
    leg = rig.leg
    ground = rig.ground
    keys = {
        "height_mm": ("zero_offset_m", 1e-3),
        "start_angle_deg": ("zero_offset_rad", float(np.radians(1.0))),
        # Absolute in a leg's file, relative in a mechanism's; the bound avoids a division by zero
        # without friction.
        "friction_coefficient": (
            "contact_friction_relative",
            1.0 / max(ground.friction_coefficient, 1e-9),
        ),
        "k0_relative": ("joint_stiffness_relative", 1.0),
        "mass_relative": ("mass_relative", 1.0),
        "hinge_damping_relative": ("joint_damping_Nm_s_per_rad", leg.hinge_damping_Nm_s_per_rad),
        "contact_stiffness_relative": ("contact_stiffness_relative", 1.0),
    }
    priors = {
        name: factor * known_to[key] for key, (name, factor) in keys.items() if known_to.get(key)
    }
    seldom = ("contact_damping_relative", "contact_presliding_relative", "contact_drag_relative")
    return {
        **priors,
        **dict.fromkeys(seldom, SELDOM_MEASURED),
        "start_swing_relative": SWING_SHARE_STD,
        "start_swing_rate_per_s": SWING_RATE_STD_PER_S,
    }


def _describe_left_out(
    rig: RigModel, recordings: Sequence[Recording], prepared: PreparedLeg
) -> list[str]:
    ground = rig.ground
    items = [f"the effect {present.id} of the nominal model" for present in rig.effects]
    if any(recording.static for recording in recordings):
        items.append("static stages: a mechanism is diagnosed from its motion")
    if ground.friction_lever_m not in (None, rig.leg.link_radius_m) or ground.friction_rise_share:
        items.append("the lever of friction: it acts at the lowest point of each end")
    if ground.leaving_damping_share != 1.0:
        items.append("the other damping of an end that leaves")
    items += [
        f"{key} of [known_to]"
        for key in ("k2_relative", "rest_angle_deg")
        if prepared.known_to.get(key)
    ]
    return [*items, *prepared.remarks]


def _shows_valley(stroke: Stroke) -> bool:
    fz = stroke.channel("fz_N")
    return fz is not None and not isinstance(valley_and_phases(*fz)[0], Undetermined)
