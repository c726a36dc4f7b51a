"""Builds one simulation from rig, height and shaft motion, and lets each effect change it."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace

import numpy as np
from numba.core.errors import NumbaError
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.chain import HELD_SHAFT, find_rest_state, make_chain, make_laws, set_swinging
from rfca_rig.model.kernel.forces import measure_once
from rfca_rig.model.kernel.laws import TABLE, LawUse, compile_law
from rfca_rig.model.kernel.state import Chain, Laws, Shaft, State, Work
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.parameters import PresentEffect, RigModel

Floats = NDArray[np.float64]

# The compiled chain reads a law's numbers from the first columns of its row; its table begins
# behind them.
MAX_PARAMETERS = TABLE


@dataclass(frozen=True)
class SensorOutput:
    """Channels of the force sensor over time, all (m,), in its axes and signs. Effects of the
    sensor change them afterwards.

    `shaft_rad` is the shaft angle at the same times.
    """

    t_s: Floats
    fy_N: Floats
    fz_N: Floats
    tx_Nm: Floats
    shaft_rad: Floats


@dataclass(frozen=True)
class CompliantDrive:
    """A shaft that does not follow its command exactly: torque k (commanded - angle) + kw
    (commanded speed - speed) on a rotor.

    With play, the part with k engages only beyond `gap_rad` on either side, as a contact of Hunt
    and Crossley: k bent (1 + loss speed). The torque stays within `limit_Nm`. The motor cogs by
    `cogging_Nm` in addition, with `cogging_cycles` cycles per turn.

    Before the motion it rests where k carries the weight of the leg. If it `holds_start`, it rests
    at the commanded angle instead, and a constant torque carries the weight. `effect` is the id of
    the effect that added it.
    """

    effect: str
    angle_gain_Nm_per_rad: float
    speed_gain_Nm_s_per_rad: float
    rotor_kg_m2: float
    holds_start: bool = False
    gap_rad: float = 0.0
    loss_s_per_rad: float = 0.0
    limit_Nm: float = float(np.inf)
    cogging_Nm: float = 0.0
    cogging_cycles: float = 0.0
    cogging_phase_rad: float = 0.0


@dataclass(frozen=True)
class Setup:
    """What is simulated. Each effect replaces the part that it changes.

    - `rig`, `height_m`, `motion`: the values.
    - `chain_changes`: applied to the finished chain.
    - `laws`: added to the equations of motion; `laws_of_chain` are built from the finished chain,
      because they depend on other effects.
    - `drive`: a compliant drive between command and shaft.
    - `sensor_changes`: applied to the sensor's channels. Those that make a reading depend on the
      force at other times need it every `sensed_every_s`, or more often.
    - `begins`: initial states, of what swings already where a recording begins.

    `strokes_before` holds, for each stroke whose mean is simulated, how many strokes the leg had
    made before; () where not counted. `moved_by` holds the effects that change more than
    `sensor_changes`: without the others, the leg moves in the same way.
    """

    rig: RigModel
    height_m: float
    motion: ShaftMotion
    chain_changes: tuple[Callable[[Chain], Chain], ...] = ()
    laws: tuple[LawUse, ...] = ()
    laws_of_chain: tuple[Callable[[Chain], LawUse], ...] = ()
    drive: CompliantDrive | None = None
    sensor_changes: tuple[Callable[[SensorOutput], SensorOutput], ...] = field(default=())
    sensed_every_s: float = float(np.inf)
    begins: tuple[Callable[[Chain, State], None], ...] = ()
    strokes_before: tuple[int, ...] = ()
    moved_by: tuple[tuple[Hashable, PresentEffect], ...] = ()

    def chain(self) -> Chain:
        """The chain with all changes."""
        chain = make_chain(self.rig, self.height_m)
        for change in self.chain_changes:
            chain = change(chain)
        return chain

    def compile_laws(self, chain: Chain) -> Laws:
        """The laws of effects in the form of the compiled chain. Raises BadInput as `check_law`
        does.
        """
        laws = self.list_laws(chain)
        for use in laws:
            check_law(use)
        return make_laws(laws)

    def list_laws(self, chain: Chain) -> tuple[LawUse, ...]:
        """The laws of all effects, in the order in which the compiled chain has them."""
        return (*self.laws, *(law(chain) for law in self.laws_of_chain))

    @property
    def begins_s(self) -> float:
        """Start time of the simulation [s]: 0, where the motion begins, or earlier where the leg
        swings already.
        """
        if self.rig.swing:
            return -self.rig.swing.before_s
        return 0.0

    def begin(self, chain: Chain, laws: Laws, work: Work) -> tuple[Shaft, State]:
        """The shaft, and the chain as it is at `begins_s`: at rest, or swinging. `work` is
        unused memory of this chain.
        """
        if self.rig.swing:
            motion = self.motion.standing_since(self.begins_s)
        else:
            motion = self.motion
        start_rad = motion.start_rad
        if self.drive is None:
            shaft = motion.shaft()
        else:
            shaft = add_drive(motion.shaft(), self.drive, start_rad)
        # A drive without an integrator sags: its spring carries the weight only where the shaft is
        # away from its command.
        sags = self.drive is not None and not self.drive.holds_start
        state = find_rest_state(chain, start_rad, laws, shaft if sags else HELD_SHAFT, work)
        if shaft.free and not sags:
            # The integrator of the drive has taken up the weight before the motion, and keeps that
            # torque.
            shaft = shaft._replace(feed=float(measure_at_rest(chain, laws, state, work)[2]))
        if self.rig.swing:
            set_swinging(chain, laws, state, self.rig.swing.share, self.rig.swing.rate_per_s, work)
            for swing in self.begins:
                swing(chain, state)
        return shaft, state

    def apply_sensor_changes(self, felt: SensorOutput) -> SensorOutput:
        """The sensor's channels (m,) after all changes, in the order in which the effects were
        stated.
        """
        for change in self.sensor_changes:
            felt = change(felt)
        return felt


def check_law(use: LawUse) -> None:
    """Raises BadInput, naming the file, for a law that cannot be compiled or has too many
    parameters.
    """
    # The law may be a lab's own, so each message names its file and function.
    code = use.law.__code__
    if len(use.parameters) > MAX_PARAMETERS:
        raise BadInput(
            f"{code.co_filename}: {code.co_name} has {len(use.parameters)} parameters, a "
            f"law takes {MAX_PARAMETERS} at most"
        )
    try:
        compile_law(use)
    except NumbaError as error:
        reason = " ".join(str(error).split())
        raise BadInput(
            f"{code.co_filename}: {code.co_name} or what it calls cannot be compiled: "
            f"{reason[:300]}"
        ) from error


def measure_at_rest(chain: Chain, laws: Laws, state: State, work: Work) -> Floats:
    """Force of the leg on its mount before the motion, (3,): fy, fz and the torque that holds
    the shaft; `work` is memory of this chain.
    """
    force = np.empty(3)
    measure_once(chain, laws, state, 0.0, state.q, state.w, state.a, work, force)
    return force


def add_drive(shaft: Shaft, drive: CompliantDrive, start_rad: float) -> Shaft:
    """The commanded shaft with a compliant drive between command and leg; `start_rad` is its
    angle before the motion.
    """
    return shaft._replace(
        free=True,
        rotor=drive.rotor_kg_m2,
        k_angle=drive.angle_gain_Nm_per_rad,
        k_speed=drive.speed_gain_Nm_s_per_rad,
        angle=start_rad,
        gap=drive.gap_rad,
        loss=drive.loss_s_per_rad,
        limit=drive.limit_Nm,
        cogging=drive.cogging_Nm,
        cycles=drive.cogging_cycles,
        phase=drive.cogging_phase_rad,
    )


def with_law(setup: Setup, law: LawUse) -> Setup:
    """The setup with one more law."""
    return replace(setup, laws=(*setup.laws, law))


def link_of_hinge(setup: Setup, effect_id: str, hinge: float) -> int:
    """Index in the chain of a hinge that is numbered from one: hinge i is the proximal one of link
    i.

    Raises BadInput, which names the effect, for a hinge that the leg does not have.
    """
    last = len(setup.rig.leg.link_lengths_m)
    # A fit varies the number continuously, so it is rounded; joint 1 is the shaft and has no hinge.
    if not 1.5 <= hinge < last + 0.5:
        raise BadInput(
            f"effect {effect_id}: hinge {hinge:g} is not there; this leg has hinges 2 to {last}"
        )
    return round(hinge) - 1


def with_chain(setup: Setup, change: Callable[[Chain], Chain]) -> Setup:
    """The setup with one more change of the finished chain."""
    return replace(setup, chain_changes=(*setup.chain_changes, change))


def with_sensor(
    setup: Setup,
    change: Callable[[SensorOutput], SensorOutput],
    sensed_every_s: float = float(np.inf),
) -> Setup:
    """The setup with one more change of the sensor's channels; `sensed_every_s` as in `Setup`."""
    return replace(
        setup,
        sensor_changes=(*setup.sensor_changes, change),
        sensed_every_s=min(setup.sensed_every_s, sensed_every_s),
    )


def with_begin(setup: Setup, swing: Callable[[Chain, State], None]) -> Setup:
    """The setup with one more initial state, of what swings already where a recording begins."""
    return replace(setup, begins=(*setup.begins, swing))


def with_drive(setup: Setup, drive: CompliantDrive) -> Setup:
    """The setup with a compliant drive. Raises BadInput for a second one: two in series need a
    coordinate that the chain lacks.
    """
    if setup.drive is not None:
        raise BadInput(
            f"{setup.drive.effect} and {drive.effect} both soften the drive; the model "
            "takes one at a time, leave one out"
        )
    return replace(setup, drive=drive)
