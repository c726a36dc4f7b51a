"""The next experiment on a pendulum: a release with the motors off, or a sine torque, within the angles and torques that were recorded."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.swings import apply_nuisances, make_swing_problem, sample_noise
from rfca_rig.campaign.pendulum import PendulumCampaign, PendulumRun
from rfca_rig.diagnosis.decision.decide import Decision
from rfca_rig.diagnosis.experiment_design.choice import SET_UP_MIN, ExperimentDesign, list_options, propose
from rfca_rig.diagnosis.experiment_design.open_hypotheses import list_open_hypotheses
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.pendulums.windows import BIN_S, WINDOW_S, PendulumInput, Stretch, cut_stretches, usual_torque_Nm
from rfca_rig.model.effects.joint_torques import torque_trace
from rfca_rig.model.parameters import GRAVITY_M_S2
from rfca_rig.model.pendulum import make_driven_pendulum

Floats = NDArray[np.float64]

REPEATS = (1, 3)  # a recording holds several stretches already


def propose_swing(campaign: PendulumCampaign, found: ModelSelectionResult, decision: Decision, enough: bool) -> dict[str, object] | None:
    """What to record or to measure next; None where nothing is open or nothing would help. Keys as for a leg, `protocol` always None."""
    hypotheses = list_open_hypotheses(found, decision, enough)
    return None if hypotheses is None else propose(list(list_options(hypotheses, _designs(campaign), enough)))


def _designs(campaign: PendulumCampaign) -> Iterator[ExperimentDesign]:
    """Releases, and sines in each driven joint where there are motors; noise and sample time as recorded."""
    first, links = campaign.runs[0], campaign.pendulum.links
    # Small swing of the first link alone: it sets durations and frequencies.
    weight_Nm = GRAVITY_M_S2 * links[0].mass_kg * links[0].centre_of_mass_m
    frequency_Hz = float(np.sqrt(weight_Nm / links[0].inertia_kg_m2) / (2.0 * np.pi)) or 1.0
    # Eight periods of the small swing, and at least two stretches.
    t_s = np.arange(0.0, max(4.0, 8.0 / frequency_Hz), float(np.median(np.diff(first.t_s))))
    seconds = round(float(t_s[-1]), 1)
    for deg in (20.0, 60.0, 120.0) if weight_Nm > 0.0 else ():  # nearly linear, usual, and far from it
        words = f"release joint 1 from {deg:g} deg with the motors off and record {seconds:g} s"
        yield _design(campaign, {"kind": "release", "start_deg": deg, "seconds": seconds}, words, t_s, None)
    torque_Nm = usual_torque_Nm(campaign.pendulum, make_swing_problem(campaign, WINDOW_S, BIN_S).windows)
    if not any(run.powered for run in campaign.runs):
        return
    for joint in [number for number, link in enumerate(links) if link.driven]:
        # At most the rms torque that weight and drive made so far; slower than the small swing, near it, and faster.
        for share, of_swing in product((0.3, 1.0), (0.3, 0.7, 1.5)):
            a_Nm, f_Hz = (float(f"{value:.3g}") for value in (share * torque_Nm[joint], of_swing * frequency_Hz))
            settings = {"kind": "sine torque", "joint": joint + 1, "amplitude_Nm": a_Nm, "frequency_Hz": f_Hz, "seconds": seconds}
            words = f"drive joint {joint + 1} with a sine of {a_Nm:g} N m at {f_Hz:g} Hz from hanging at rest and record {seconds:g} s"
            torque = np.outer(a_Nm * np.sin(2.0 * np.pi * f_Hz * t_s), np.arange(len(links)) == joint)
            yield _design(campaign, settings, words, t_s, torque)


def _design(campaign: PendulumCampaign, settings: dict[str, object], words: str, t_s: Floats, torque_Nm: Floats | None) -> ExperimentDesign:
    """One recording from rest, with a torque over time (m, n), or released with the motors off.

    It returns None where a joint would turn farther than it was recorded to.
    """
    first, links = campaign.runs[0], len(campaign.pendulum.links)
    noise = zip(("angle_rad", "speed_rad_s"), sample_noise(first, campaign.noise_std), strict=False)
    like = replace(campaign, noise_std={name: float(std.max()) for name, std in noise})
    widest_rad = np.max([np.abs(run.angle_rad).max(axis=0) for run in campaign.runs], axis=0)
    is_powered, kind = torque_Nm is not None, str(settings["kind"])
    torque = np.zeros((len(t_s), links)) if torque_Nm is None else torque_Nm
    start_rad = np.append(np.radians(float(str(settings.get("start_deg", 0.0)))), np.zeros(links - 1))

    def simulate(at: PendulumInput) -> Stretch | None:
        ready = make_driven_pendulum(apply_nuisances(campaign.pendulum, dict(at.off)), at.rig.effects)
        motion = ready.swing(replace(torque_trace(t_s, torque), powered=is_powered), start_rad, np.zeros(links), t_s[1:])
        angle_rad, speed_rad_s = np.vstack([start_rad, motion.angle_rad]), np.vstack([np.zeros(links), motion.speed_rad_s])
        if (np.abs(angle_rad).max(axis=0) > widest_rad).any():
            return None
        speed = None if first.speed_rad_s is None else speed_rad_s
        run = PendulumRun(f"{kind}, repeat 1", kind, 1, t_s, angle_rad, speed, torque, is_powered)
        stretches = cut_stretches(make_swing_problem(replace(like, runs=(run,)), WINDOW_S, BIN_S))
        return replace(stretches[0], windows=tuple(window for stretch in stretches for window in stretch.windows))

    and_back_to_rest_min = 2.0 * float(t_s[-1]) / 60.0
    return ExperimentDesign(settings, words, SET_UP_MIN, and_back_to_rest_min, REPEATS, simulate)
