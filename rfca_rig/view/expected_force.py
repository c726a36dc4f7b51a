"""The force that the model expects in the strokes that a page shows, beside the measured one.

Each condition is predicted once, on a thread of the view's own process, and sent to a page once.
Where its strokes begin on the page's time follows as a list.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from rfca_rig.analysis.predicted_force import CHANNELS, PredictedForce, predict_force
from rfca_rig.bench.expectation import SAMPLE_S
from rfca_rig.description.model_file import nominal_model
from rfca_rig.errors import RigError
from rfca_rig.model.parameters import RigModel
from rfca_rig.view.messages import CHANNELS as SHOWN_CHANNELS
from rfca_rig.view.messages import Message
from rfca_rig.view.pyramid import Floats
from rfca_rig.view.run_facts import ExpectedStroke

DECIMALS = {channel.name: channel.decimals for channel in SHOWN_CHANNELS}


@dataclass(frozen=True)
class PlacedStroke:
    """Where a stroke is on the page's time: from its commanded start to the end of what is
    expected, in s.
    """

    from_s: float
    to_s: float
    condition: str


class ExpectedForces:
    """Predictions by condition, none until `prepare` has made them.

    The first `prepare` of a process compiles the model. Never call it in the process whose loop
    drives a motor.
    """

    def __init__(self, nominal: Mapping[str, Any], known_to: Mapping[str, float]) -> None:
        self._known_to = known_to
        self._rig: RigModel | None = None
        if nominal:
            # As for the leg: a model section that this version cannot read costs the expectation.
            with suppress(RigError):
                self._rig = nominal_model(nominal)
        self._messages: dict[str, Message] = {}

    def prepare(self, strokes: Iterable[ExpectedStroke | None]) -> None:
        """Predicts each condition once, up to the end of its longest stroke. Where the model fails,
        nothing is expected.
        """
        if self._rig is None:
            return
        longest: dict[str, ExpectedStroke] = {}
        for stroke in strokes:
            if stroke is None:
                continue
            known = longest.get(stroke.condition)
            if known is None or stroke.duration_s > known.duration_s:
                longest[stroke.condition] = stroke
        for condition, stroke in longest.items():
            force = _predict(self._rig, self._known_to, stroke)
            if force is not None:
                self._messages[condition] = _message(condition, force)

    def message(self, condition: str) -> Message | None:
        """What a page is sent of a condition; None while there is no prediction."""
        return self._messages.get(condition)


def _predict(
    rig: RigModel, known_to: Mapping[str, float], stroke: ExpectedStroke
) -> PredictedForce | None:
    """With its band; without one where a value moved by its uncertainty gives no stroke. None where
    the stroke itself cannot be simulated.
    """
    for stated in (known_to, {}):
        with suppress(RigError):
            return predict_force(
                rig, stated, stroke.height_m, stroke.speed_rad_s, stroke.duration_s
            )
    return None


def _message(condition: str, force: PredictedForce) -> Message:
    channels = {}
    for column, name in enumerate(CHANNELS):
        lines = {"value": _numbers(force.values[:, column], name)}
        if force.low is not None and force.high is not None:
            lines["low"] = _numbers(force.low[:, column], name)
            lines["high"] = _numbers(force.high[:, column], name)
        channels[name] = lines
    return {"kind": "expected", "condition": condition, "dt_s": SAMPLE_S, "channels": channels}


def _numbers(values: Floats, channel: str) -> list[float]:
    numbers: list[float] = np.round(values, DECIMALS[channel]).tolist()
    return numbers


class ExpectedFeed:
    """What one page still has to be sent of the expected forces."""

    def __init__(self, forces: ExpectedForces) -> None:
        self._forces = forces
        self._strokes: Sequence[PlacedStroke] = ()
        self._missing: dict[str, None] = {}
        self._sent: set[str] = set()

    def new_messages(self, strokes: Sequence[PlacedStroke]) -> list[Message]:
        """The list of strokes where it is another than at the last call, and the predictions that
        were made meanwhile.
        """
        messages: list[Message] = []
        # A list that changes is replaced, so that identity tells whether the page has it.
        if strokes is not self._strokes:
            self._strokes = strokes
            conditions = dict.fromkeys(stroke.condition for stroke in strokes)
            self._missing = {name: None for name in conditions if name not in self._sent}
            messages.append({"kind": "strokes", "strokes": [_placed(stroke) for stroke in strokes]})
        for condition in list(self._missing):
            message = self._forces.message(condition)
            if message is not None:
                messages.append(message)
                self._sent.add(condition)
                del self._missing[condition]
        return messages


def _placed(stroke: PlacedStroke) -> dict[str, object]:
    return {
        "from_s": round(stroke.from_s, 6),
        "to_s": round(stroke.to_s, 6),
        "condition": stroke.condition,
    }
