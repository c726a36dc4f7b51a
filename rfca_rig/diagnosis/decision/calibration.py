"""Probabilities of statements, calibrated on the blind benchmark.

A statement ("the pins have dry friction", "the spring has memory") is true with probability

    P = 1 / (1 + exp(-(b + w . f)))

f are the features of its `Support`, each limited to the range in which it is informative. The
intercept b and the weights w come from benchmark cases with known truth. They are fitted by
logistic regression with a ridge penalty, and the meaning of a feature fixes the sign of its weight.
`calibration.json` beside this module holds them with the seeds that were used, and with the scores
on cases that were not fitted. `python -m rfca_rig.exam.calibrate` writes it.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from rfca_rig.diagnosis.decision.comparison import Support

Floats = NDArray[np.float64]
Kind = Literal["effect", "family"]

FORMAT = "rfca-calibration/1"
FILE = "calibration.json"


@dataclass(frozen=True)
class Feature:
    """One feature, limited to `low` .. `high`; `sign` is that of its weight, +1 where it
    supports a statement.
    """

    name: str
    low: float
    high: float
    sign: int

    def of(self, values: Mapping[str, float]) -> float:
        """The limited value."""
        return float(
            np.clip(
                np.nan_to_num(values[self.name], nan=self.low, posinf=self.high, neginf=self.low),
                self.low,
                self.high,
            )
        )


# Limits and signs are those of the table "Support of a statement" in section 7 of docs/method.md.
FEATURES = (
    # A Bayes factor above 1000 says no more: laws are approximate, and a wrong law may win by
    # hundreds of log units. Cross-validated on 288 cases, a limit of 100,000 log units instead
    # lowers the mean log score of effects from -0.277 to -0.299, that of families from -0.238 to
    # -0.256.
    Feature("log_bayes_factor", 0.0, float(np.log1p(np.log(1000.0))), 1),
    Feature("held_out_ratio", 0.0, 3.0, 1),
    Feature("law_error_without", 0.0, 1.0, 1),
    Feature("remaining_misfit", 0.5, 4.0, -1),
    Feature("relief", 0.0, 8.0, 1),
)


@dataclass(frozen=True)
class Calibration:
    """Intercept and weights (features,) of one kind of statement."""

    intercept: float
    weights: Floats

    def probability(self, values: Mapping[str, float]) -> float:
        """Probability of a statement whose support has these values."""
        return float(expit(self.intercept + self.weights @ features_in(values)))


def support_values(support: Support) -> dict[str, float]:
    """The support as plain numbers, as `diagnosis.json` keeps it for a later calibration."""
    return {
        "log_bayes_factor": float(np.log1p(max(support.log_bayes_factor, 0.0))),
        "held_out_ratio": support.held_out_ratio,
        "law_error_without": support.law_error_without,
        "remaining_misfit": support.remaining_misfit,
        "removed_share": support.removed_share,
        "relief": support.relief,
    }


def features_in(values: Mapping[str, float]) -> Floats:
    """The limited features of plain values, (features,), in the order of FEATURES."""
    return np.array([feature.of(values) for feature in FEATURES])


@cache
def calibration_of(kind: Kind) -> Calibration:
    """The calibration of one kind of statement that comes with the package; read once.

    Raises
    ------
    ValueError
        Where the file does not hold exactly the features of this version.
    """
    content = json.loads((files(__package__) / FILE).read_text(encoding="utf-8"))
    # A file of another version may have other features; its weights would be applied to the wrong
    # numbers.
    weights = content[kind]["weights"]
    if content["format"] != FORMAT or set(weights) != {feature.name for feature in FEATURES}:
        raise ValueError(
            f"{FILE}: holds {', '.join(weights)}; regenerate it with python -m "
            "rfca_rig.exam.calibrate"
        )
    return Calibration(
        float(content[kind]["intercept"]),
        np.array([float(weights[feature.name]) for feature in FEATURES]),
    )
