"""The next experiment on a pendulum: a release with the motors off, or a sine torque, that best tells the open hypotheses apart."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import Supposed
from rfca_rig.analysis.swings import sample_noise, shifted, swings_of
from rfca_rig.campaign.pendulum import PendulumCampaign, PendulumRun
from rfca_rig.diagnosis.decision.decide import Decision
from rfca_rig.diagnosis.experiment_design.designs import Kind
from rfca_rig.diagnosis.experiment_design.next_experiment import choose_option, off_rig_options, on_rig_options, proposal_of
from rfca_rig.diagnosis.experiment_design.open_hypotheses import contest_of
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.pendulums.nuisances import of_pendulum
from rfca_rig.diagnosis.pendulums.windows import BIN_S, WINDOW_S, Stretch, stretches_of, usual_torque_Nm
from rfca_rig.errors import BadInput
from rfca_rig.model.joint_drive import torque_trace
from rfca_rig.model.parameters import GRAVITY_M_S2
from rfca_rig.model.pendulum import driven

Floats = NDArray[np.float64]

SET_UP_MIN = 2.0
REPEATS = (1, 3)
RELEASES_DEG = (20.0, 60.0, 120.0)  # nearly linear, usual, and far from it
AMPLITUDES = (0.3, 1.0)  # of the rms torque that weight and drive made in the recordings, so never more than the rig has borne
FREQUENCIES = (0.3, 0.7, 1.5)  # of the small swing
SWINGS = 8  # how long a recording takes, in periods of the small swing,
SHORTEST_S = 4.0  # and at least


@dataclass(frozen=True)
class SwingCandidate:
    """One recording that could be made: a start angle of joint 1, and a torque over time (m, n), None for a release with the motors off.

    No joint may turn farther than `widest_rad` (n,) from zero: the rig is asked for no more than it has done.
    """

    kind: Kind
    setting: tuple[tuple[str, float], ...]
    campaign: PendulumCampaign
    start_rad: float
    t_s: Floats
    torque_Nm: Floats | None
    widest_rad: Floats
    repeats: tuple[int, ...] = REPEATS

    def minutes(self, repeats: int) -> float:
        """The recordings, and some time to come to rest after each."""
        return SET_UP_MIN + repeats * 2.0 * float(self.t_s[-1]) / 60.0

    def part(self, supposed: Supposed) -> Stretch | None:
        """The recording as the supposed pendulum would make it, without noise; None if too short or wide. Raises SimulationFailed."""
        links = len(self.campaign.pendulum.links)
        torque = np.zeros((len(self.t_s), links)) if self.torque_Nm is None else self.torque_Nm
        trace = replace(torque_trace(self.t_s, torque), powered=self.torque_Nm is not None)
        ready = driven(shifted(self.campaign.pendulum, dict(of_pendulum(supposed).off)), supposed.rig.effects)
        start = np.append(self.start_rad, np.zeros(links - 1))
        motion = ready.swing(trace, start, np.zeros(links), self.t_s[1:])
        angle = np.vstack([start, motion.angle_rad])
        if (np.abs(angle).max(axis=0) > self.widest_rad).any():
            return None
        speed = np.vstack([np.zeros(links), motion.speed_rad_s]) if self.campaign.runs[0].speed_rad_s is not None else None
        run = PendulumRun(f"{self.kind}, repeat 1", self.kind, 1, self.t_s, angle, speed, torque, trace.powered)
        try:
            stretches = stretches_of(swings_of(replace(self.campaign, runs=(run,)), WINDOW_S, BIN_S))
        except BadInput:
            return None
        return replace(stretches[0], windows=tuple(window for stretch in stretches for window in stretch.windows))

    def described(self) -> dict[str, object]:
        """Kind and settings."""
        return {"kind": self.kind, **dict(self.setting), "seconds": round(float(self.t_s[-1]), 1)}


def next_swing(campaign: PendulumCampaign, found: ModelSelectionResult, decision: Decision, enough: bool) -> dict[str, object] | None:
    """What to record or to measure next; None where nothing is open or nothing would help. Keys as for a leg, `protocol` always None."""
    contest = contest_of(found, decision, enough)
    if contest is None or len(contest.open) < 2:
        return None
    options = [replace(option, how=_words(option.described)) for option in on_rig_options(contest, list(_candidates(campaign)))]
    if enough:
        options += off_rig_options(contest)
    return proposal_of(choose_option(options)) if options else None


def _words(values: Mapping[str, object]) -> str:
    if values["kind"] == "release":
        return f"release joint 1 from {values['start_deg']:g} deg with the motors off and record {values['seconds']:g} s"
    return (
        f"drive joint {values['joint']:g} with a sine of {values['amplitude_Nm']:.3g} N m at {values['frequency_Hz']:.3g} Hz "
        f"from hanging at rest and record {values['seconds']:g} s"
    )


def _candidates(campaign: PendulumCampaign) -> Iterator[SwingCandidate]:
    """Releases, and where there are motors sines in each driven joint; noise and sample time as recorded."""
    problem = swings_of(campaign, WINDOW_S, BIN_S)
    first = campaign.runs[0]
    noise = sample_noise(first, campaign.noise_std)
    stated = {name: float(std.max()) for name, std in zip(("angle_rad", "speed_rad_s"), noise, strict=False)}
    widest_rad = np.max([np.abs(run.angle_rad).max(axis=0) for run in campaign.runs], axis=0)
    like = replace(campaign, noise_std=stated)
    link = campaign.pendulum.links[0]
    weight = GRAVITY_M_S2 * link.mass_kg * link.centre_of_mass_m
    frequency_Hz = float(np.sqrt(weight / link.inertia_kg_m2) / (2.0 * np.pi)) or 1.0
    t_s = np.arange(0.0, max(SHORTEST_S, SWINGS / frequency_Hz), float(np.median(np.diff(first.t_s))))
    if weight > 0.0:
        for deg in RELEASES_DEG:
            yield SwingCandidate("release", (("start_deg", deg),), like, float(np.radians(deg)), t_s, None, widest_rad)
    torque_Nm = usual_torque_Nm(campaign.pendulum, problem.windows)
    if any(run.powered for run in campaign.runs):
        for joint in [i for i, each in enumerate(campaign.pendulum.links) if each.driven]:
            for amplitude in AMPLITUDES:
                for share in FREQUENCIES:
                    yield _sine(like, t_s, widest_rad, joint, (amplitude * float(torque_Nm[joint]), share * frequency_Hz))


def _sine(campaign: PendulumCampaign, t_s: Floats, widest_rad: Floats, joint: int, sine: tuple[float, float]) -> SwingCandidate:
    """`sine` is its amplitude in N m and its frequency in Hz."""
    amplitude_Nm, frequency_Hz = (float(f"{value:.3g}") for value in sine)
    torque = np.zeros((len(t_s), len(campaign.pendulum.links)))
    torque[:, joint] = amplitude_Nm * np.sin(2.0 * np.pi * frequency_Hz * t_s)
    setting = (("joint", joint + 1), ("amplitude_Nm", amplitude_Nm), ("frequency_Hz", frequency_Hz))
    return SwingCandidate("sine torque", setting, campaign, 0.0, t_s, torque, widest_rad)
