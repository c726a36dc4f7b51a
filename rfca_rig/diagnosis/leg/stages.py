"""Static stages of one height as observations, and their simulation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.diagnosis.data import Label, Observations
from rfca_rig.model.catalogue import declarations, set_up
from rfca_rig.model.chain import Tolerance
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.static_stages import StageMoves, make_stage_motion
from rfca_rig.model.stroke import SimulatedStroke, StrokeRequest, simulate_setup
from rfca_rig.recording.model import StaticStage, collect_strokes_before

Floats = NDArray[np.float64]

FORCES = ("fy_N", "fz_N", "tx_Nm")
# a stage's mean is at least this much quieter, squared, than one sample: readings drift while they
# are averaged
MEAN_OF_SAMPLES = 5.0
HINGE_NOISE_DEG = 0.2  # of a red mark in a photograph, where the table does not say
STAGE_APART_RAD = 0.4  # stages this far apart err on their own
UNKNOWN_FRICTION = 30.0  # of the usual friction: 0.3 of it goes with a model error of 1 %
# A third less work than by default; what is read changes by some hundredths of what a model usually
# errs by.
CLOSE_ENOUGH = Tolerance(3e-5, 9e-2, 0.04, most_steps=200_000)
REMEMBERED = 256  # tables, some kilobytes each
HOLD_S = 0.3  # the slowest swing of the paper's leg has died out


@dataclass(frozen=True)
class StageTable:
    """The stages of one height in their order, approached as `moves` says.

    Parameters
    ----------
    height_m
        Height of the shaft.
    stages
        The recorded stages.
    moves
        How the shaft moves from stage to stage.
    noise
        Standard deviations by signal.
    stopped_as_commanded
        Whether the shaft stopped at its commanded angle. If not, it may have moved back a little at
        every stop. Friction then holds the tip with a force that cannot be predicted.
    recording
        The run that it is a part of, where that matters; "" where it does not.
    """

    height_m: float
    stages: tuple[StaticStage, ...]
    moves: StageMoves
    noise: Mapping[str, float]
    stopped_as_commanded: bool = True
    recording: str = ""

    @property
    def signals(self) -> tuple[str, ...]:
        hinges = len(self.stages[0].hinge_deg)
        return (*FORCES, *(f"hinge{i}_deg" for i in range(2, 2 + hinges)))

    @property
    def repeats(self) -> Floats:
        """None, as (1, 0): each stage is read once."""
        return np.empty((1, 0))

    def simulated(self, supposed: ModelPoint) -> Floats:
        """Predicted rows (m,), signal after signal, without those that were not measured. Raises
        SimulationFailed.
        """
        return self._select_measured(_simulate_stages(*self._settled(supposed)))

    def request(self, supposed: ModelPoint) -> StrokeRequest:
        """The motion through all stages to simulate. Raises BadInput for effects that do not
        fit.
        """
        return _request_stages(*self._settled(supposed))

    def read(self, supposed: ModelPoint, held: SimulatedStroke) -> Floats:  # noqa: ARG002  (the shaft's condition needs it)
        """Rows (m,) of a motion that was simulated as requested."""
        return self._select_measured(_read_signals(held))

    def _select_measured(self, signals: Floats) -> Floats:
        return np.concatenate(signals[: len(self.signals)])[self._is_measured()]

    def _settled(
        self, supposed: ModelPoint
    ) -> tuple[RigModel, float, tuple[float, ...], StageMoves, tuple[int, ...]]:
        """What is simulated for this input: rig, height, angles of the stages, moves, and the
        strokes before.
        """
        turned = tuple(stage.shaft_angle_rad + supposed.turn_offset_rad for stage in self.stages)
        # A settled reading does not show what acts in motion only. The sensor is tared at each
        # stage, so what it adds over time does not show either.
        in_motion_only = {effect.id for effect in declarations() if effect.in_motion_only}
        settled = tuple(
            effect
            for effect in supposed.rig.effects
            if not (
                effect.id in in_motion_only
                or (effect.table is not None and effect.table.argument == "time_s")
            )
        )
        rig = replace(supposed.rig, swing=None, effects=settled)
        before = collect_strokes_before(self.stages[:1])
        return rig, self.height_m + supposed.height_offset_m, turned, self._moves(), before

    def _moves(self) -> StageMoves:
        """The moves with the mean holding time of the stages, if all of them state it."""
        held = [stage.held_s for stage in self.stages if stage.held_s is not None]
        if len(held) == len(self.stages):
            return replace(self.moves, hold_s=float(np.mean(held)))
        return self.moves

    def _stack_measured(self) -> Floats:
        forces_of = attrgetter(*FORCES)
        forces = np.array([forces_of(stage) for stage in self.stages])
        hinges_deg = np.array([stage.hinge_deg for stage in self.stages])
        return np.concatenate([*forces.T, *hinges_deg.T])

    def _unknown_friction(self) -> Floats:
        """Possible change of each signal if friction holds the tip otherwise than predicted,
        (signals,).
        """
        if self.stopped_as_commanded:
            return np.zeros(len(self.signals))
        friction = UNKNOWN_FRICTION * float(
            np.sqrt(np.mean([stage.fy_N**2 for stage in self.stages]))
        )
        return np.array(
            [friction, friction, self.height_m * friction]
            + [0.0] * (len(self.signals) - len(FORCES))
        )

    def _is_measured(self) -> NDArray[np.bool_]:
        return np.isfinite(self._stack_measured())

    def rows(self) -> Observations:
        """The measured rows; what was not measured (NaN) is omitted."""
        present = self._is_measured()
        stages = len(self.stages)
        signals = self.signals
        measured = self._stack_measured()
        table = measured.reshape(len(signals), stages)
        # A relative error refers to the rms of each signal over the whole table.
        if np.isfinite(table).any():
            scale = np.sqrt(np.nanmean(table**2, axis=1))
        else:
            scale = np.ones(len(signals))
        angle = np.array([stage.shaft_angle_rad for stage in self.stages])
        phase = np.array([stage.direction for stage in self.stages])
        label = np.repeat(np.arange(len(signals)), stages)
        return Observations(
            measured=measured[present],
            noise=np.repeat([self.noise[signal] for signal in signals], stages)[present],
            scale=np.nan_to_num(np.repeat(scale, stages)[present], nan=1.0),
            transient_scale=np.repeat(self._unknown_friction(), stages)[present],
            progress=np.tile(angle / STAGE_APART_RAD, len(signals))[present],
            # A stage has no time; its shaft angle takes that place.
            t_s=np.tile(angle, len(signals))[present],
            phase=np.tile(phase, len(signals))[present],
            label=label[present],
            condition=np.zeros(int(present.sum()), dtype=np.intp),
            labels=tuple(
                Label("static", f"{1e3 * self.height_m:g} mm", signal, recording=self.recording)
                for signal in signals
            ),
        )


@lru_cache(maxsize=REMEMBERED)
def _simulate_stages(
    rig: RigModel,
    height_m: float,
    turned_rad: tuple[float, ...],
    moves: StageMoves,
    strokes_before: tuple[int, ...],
) -> Floats:
    """The three forces and all hinge angles of the model at these stages, (3 + hinges, stages).

    Cached: a fit often changes something that no settled reading shows, for example the swing of
    the leg at the start.
    """
    request = _request_stages(rig, height_m, turned_rad, moves, strokes_before)
    return _read_signals(simulate_setup(request.setup, request.t_s, request.tolerance))


def _request_stages(
    rig: RigModel,
    height_m: float,
    turned_rad: tuple[float, ...],
    moves: StageMoves,
    strokes_before: tuple[int, ...],
) -> StrokeRequest:
    motion, read_s = make_stage_motion(rig.leg.start_angle_rad, turned_rad, moves)
    return StrokeRequest(set_up(rig, height_m, motion, strokes_before), read_s, CLOSE_ENOUGH)


def _read_signals(held: SimulatedStroke) -> Floats:
    return np.array([held.fy_N, held.fz_N, held.tx_Nm, *np.degrees(np.diff(held.q_rad, axis=1)).T])


def make_stage_tables(
    stages: Sequence[StaticStage], noise_std: Mapping[str, float | None], moves: StageMoves
) -> tuple[StageTable, ...]:
    """One table per height, and a new one after strokes in between, in the order in which the
    stages were recorded.
    """
    tables: dict[tuple[float, int | None], list[StaticStage]] = {}
    for stage in stages:
        tables.setdefault((round(stage.height_m, 4), stage.strokes_before), []).append(stage)
    return tuple(
        StageTable(height, tuple(table), moves, _estimate_noise(table, noise_std))
        for (height, _), table in tables.items()
    )


def _estimate_noise(
    stages: Sequence[StaticStage], noise_std: Mapping[str, float | None]
) -> dict[str, float]:
    # Usual noise of one sample, where neither the table nor the rig file states it.
    usual = {"fy_N": 0.1, "fz_N": 0.15, "tx_Nm": 0.006}
    noise = {}
    for name in FORCES:
        stated = [stage.std[name] for stage in stages if name in stage.std]
        if stated:
            noise[name] = float(np.mean(stated))
        else:
            of_sample = noise_std.get(name) or usual[name]
            noise[name] = float(of_sample / np.sqrt(MEAN_OF_SAMPLES))
    for i in range(2, 2 + len(stages[0].hinge_deg)):
        noise[f"hinge{i}_deg"] = HINGE_NOISE_DEG
    return noise
