"""A run with something going wrong in it, and what became of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.engine.run import Supervision, prove_stop, run_plan
from rfca_rig.errors import RigError, Tripped
from rfca_rig.protocol.plan import Flap, Hold, Stage
from rfca_rig.recording import run_folder
from tests.runner_faults.cause import GOES_ON, Cause
from tests.runner_faults.rig import CHEAP, FaultyRig, Fidelity, faulty_rig, short_limits, short_plan
from tests.runner_faults.truth import Stop, stop_after

WATCHDOG_S = 0.1


@dataclass(frozen=True)
class Outcome:
    """`ended` by which code or error; `lost` are acknowledged stages that cannot be read back;
    `energised_s` after the run's end.

    `obeyed_s` is how long the drive gave torque after the first order to let go had left; NaN where
    none left.
    """

    ended: str
    message: str
    not_disabled: bool
    stop: Stop
    energised_s: float
    obeyed_s: float
    motion_frames: int
    acknowledged: int
    lost: int

    @property
    def is_safe(self) -> bool:
        """A drive that could not be disabled is left to its watchdog, and the operator asked to
        press the emergency stop.
        """
        obeys = self.not_disabled or self.obeyed_s == 0.0
        return (
            obeys
            and self.energised_s <= (WATCHDOG_S if self.not_disabled else 0.0)
            and self.motion_frames == 0
            and self.lost == 0
        )


class Hooked:
    """A sink that tells when a recorded stage begins."""

    def __init__(self, sink: Any, begun: Callable[[Flap | Hold, float], None]) -> None:
        self._sink = sink
        self._begun = begun
        self._stage: Flap | Hold | None = None

    def begin(self, stage: Flap | Hold) -> None:
        self._stage = stage
        self._sink.begin(stage)

    def start(self, start_s: float, turns_rad: float) -> None:
        self._sink.start(start_s, turns_rad)
        self._begun(self._stage, start_s)

    def __getattr__(self, name: str) -> object:
        return getattr(self._sink, name)


def caused(cause: Cause, folder: Path, fidelity: Fidelity = CHEAP) -> Outcome:
    """The cause begins half way through the stroke, in contact with the floor; or where the
    shaft is about to be held.
    """

    def begun(stage: Flap | Hold, start_s: float) -> None:
        if isinstance(stage, Hold) and cause.in_hold:
            begin_now(rig, cause)
        elif isinstance(stage, Flap) and not cause.in_hold:
            rig.agenda.at(start_s + 0.5 * stage.stroke_s, lambda: begin_now(rig, cause))

    with faulty_rig(folder, fidelity) as rig:
        rig.plan = short_plan(short_limits(), fidelity, cause.speed_rad_s, cause.hold_s)
        if cause.at_arming:
            begin_now(rig, cause)
            return ended_by(rig, lambda: prove_stop(rig.bench))
        return run_to_its_end(rig, Hooked(rig.recorder, begun))


def begin_now(rig: FaultyRig, *causes: Cause) -> None:
    if np.isnan(rig.begun_s):
        if rig.truth.moments:
            rig.begun_s = rig.truth.moments[-1].at_s
        else:
            rig.begun_s = 0.0
    for cause in causes:
        cause.begin(rig)


def run_to_its_end(rig: FaultyRig, sink: Any) -> Outcome:
    """Carries the rig's plan out, whatever comes; raises what is no error of a kind that the
    command line knows.
    """
    return ended_by(
        rig,
        lambda: run_plan(
            rig.plan, rig.bench, sink, _nothing, Supervision(rig.expected(), rig.stop_request)
        ),
    )


def ended_by(rig: FaultyRig, work: Callable[[], object]) -> Outcome:
    """What became of the work, and of the rig for a while after it."""
    ended = GOES_ON
    error = None
    try:
        work()
    except RigError as caught:
        error = caught
        ended = code_of(caught)
    over_s = rig.clock.now_s()
    acknowledged = rig.keeper.acknowledged
    rig.clock.wait_until(over_s + rig.watched_s)
    rig.keeper.finish(ended)
    kept = run_folder.read_stages(rig.folder)
    return Outcome(
        ended=ended,
        message=str(error or ""),
        not_disabled=error is not None and "could not be disabled" in str(error),
        stop=stop_after(rig.truth.moments, rig.begun_s),
        energised_s=_energised_s(rig, over_s),
        obeyed_s=_energised_s(
            rig, np.nan if (told_s := rig.bus.told_to_let_go_s()) is None else told_s
        ),
        motion_frames=rig.bus.motion_after_stop(),
        acknowledged=acknowledged,
        lost=max(0, acknowledged - len(kept.strokes) - len(kept.static)),
    )


def code_of(error: BaseException) -> str:
    """The trip's code, also where what was raised last is that the drive could not be disabled."""
    chain: Sequence[BaseException] = [error, *([error.__context__] if error.__context__ else [])]
    while chain[-1].__context__ is not None and chain[-1].__context__ not in chain:
        chain = [*chain, chain[-1].__context__]
    trips = [one for one in chain if isinstance(one, Tripped)]
    if trips:
        return str(trips[0].code)
    return type(error).__name__


def _energised_s(rig: FaultyRig, over_s: float) -> float:
    """How long the drive gave torque after that."""
    if np.isnan(over_s):
        return over_s
    return max(
        (moment.at_s - over_s for moment in rig.truth.after(over_s) if moment.powered),
        default=0.0,
    )


def _nothing(_stage: Stage) -> None:
    """Progress nobody watches."""
