"""Fits the probabilities of statements to benchmark cases: python -m rfca_rig.exam.calibrate
SOURCE... --out calibration.json

A SOURCE is the folder of a finished benchmark (`rfca-rig prove`), or a file of labelled statements
about other rigs (rfca-statements/1). Each diagnosis of a benchmark holds the support of the effects
and families of its best explanation. The truths are opened, and give the label of each. A fit to
every second case is judged on the others, each kind of rig by itself. The weights that are written
are fitted to all.

rfca-statements/1 is JSON: `words` say what was simulated, and each entry of `statements` has
`case`, `rig`, `kind` ("effect" or "family"), `values` (the support, as in diagnosis.json) and
`true`.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, log_expit

from rfca_rig.diagnosis.config import STATED_PROBABILITY
from rfca_rig.diagnosis.decision.calibration import FEATURES, FORMAT, features_in
from rfca_rig.errors import BadInput, RigError
from rfca_rig.exam.answer import parse_truth
from rfca_rig.exam.claims import PROBABILITY_FLOOR, calibration_error, is_true
from rfca_rig.exam.examine import DIAGNOSES
from rfca_rig.exam.pendulums.cases import PENDULUM_KINDS
from rfca_rig.exam.sealing import open_all, read_plan
from rfca_rig.recording.atomic import write_atomically

Floats = NDArray[np.float64]

# Prior standard deviation of a weight, per standard deviation of its feature.
RIDGE = 1.0
STATEMENTS = "rfca-statements/1"
LEG = "leg"
PENDULUM = "pendulum"


@dataclass(frozen=True)
class Labelled:
    """Statements of one kind.

    Parameters
    ----------
    features
        (n, f) their limited features.
    true
        (n,) whether each is true.
    case, rig
        (n,) the case of each, unique among all sources, and the kind of rig that it is about.
    """

    features: Floats
    true: NDArray[np.bool_]
    case: NDArray[np.str_]
    rig: NDArray[np.str_]

    def select(self, rows: NDArray[np.bool_]) -> "Labelled":
        """Those of the statements that a mask (n,) selects."""
        return Labelled(self.features[rows], self.true[rows], self.case[rows], self.rig[rows])


@dataclass(frozen=True)
class Statement:
    """One labelled statement, as a source holds it."""

    case: str
    rig: str
    kind: str
    values: Mapping[str, float]
    true: bool


def read_statements(source: Path) -> tuple[str, list[Statement]]:
    """What a source holds, in words, and its statements.

    Raises
    ------
    BadInput
        Where a file is not of the format, or the folder is no benchmark.
    """
    if source.is_file():
        return _read_file(source)
    return _read_benchmark(source)


def _read_file(path: Path) -> tuple[str, list[Statement]]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["format"] != STATEMENTS:
            raise BadInput(f"{path}: format {content['format']!r} should be {STATEMENTS}")
        listed = [
            Statement(
                f"{path.name}/{statement['case']}",
                str(statement["rig"]),
                str(statement["kind"]),
                statement["values"],
                bool(statement["true"]),
            )
            for statement in content["statements"]
        ]
        return str(content["words"]), listed
    except (json.JSONDecodeError, KeyError, TypeError) as error:
        raise BadInput(
            f"{path}: is no file of statements, {type(error).__name__} at {error}; see "
            f"the format {STATEMENTS}"
        ) from None


def _read_benchmark(folder: Path) -> tuple[str, list[Statement]]:
    statements = []
    diagnosed = 0
    for truth in open_all(folder):
        path = folder / DIAGNOSES / truth["case"] / "diagnosis.json"
        if not path.is_file():
            continue
        diagnosed += 1
        rig = PENDULUM if truth["kind"] in PENDULUM_KINDS else LEG
        for statement in json.loads(path.read_text(encoding="utf-8")).get("support", ()):
            is_right = is_true(
                statement["kind"],
                {statement["id"], *statement.get("cannot_tell_from", ())},
                parse_truth(truth),
            )
            statements.append(
                Statement(
                    f"{folder.name}/{truth['case']}",
                    rig,
                    statement["kind"],
                    statement["values"],
                    is_right,
                )
            )
    return f"{read_plan(folder).words}, {diagnosed} of them diagnosed", statements


def list_fitted_cases(statements: Sequence[Statement]) -> list[str]:
    """Every second case: a fit to its statements is judged on those of the others."""
    # Names of one rig follow each other in this order, so that each half has as many of its cases.
    return sorted({statement.case for statement in statements})[::2]


def label(statements: Sequence[Statement], kind: str) -> Labelled:
    """The statements of a kind ("effect" or "family"), as arrays.

    Raises
    ------
    BadInput
        Where there are none.
    """
    of_kind = [statement for statement in statements if statement.kind == kind]
    if not of_kind:
        raise BadInput(
            f"no diagnosis with support for a calibration of kind {kind!r}; run rfca-rig "
            "prove first"
        )
    return Labelled(
        np.array([features_in(statement.values) for statement in of_kind]),
        np.array([statement.true for statement in of_kind]),
        np.array([statement.case for statement in of_kind]),
        np.array([statement.rig for statement in of_kind]),
    )


def fit_weights(labelled: Labelled) -> tuple[float, Floats]:
    """Fit a logistic regression by maximum a posteriori; each weight has the sign of its feature.

    Returns
    -------
    intercept : float
        Log odds at zero features; its prior is flat.
    weights : (f,) array
        Per unit of each feature. Their prior is normal, with RIDGE per standard deviation of the
        feature.
    """
    # A feature that is constant in these cases would divide by zero.
    spread = np.maximum(labelled.features.std(axis=0), 1e-9)
    middle = labelled.features.mean(axis=0)
    scaled = (labelled.features - middle) / spread
    sign = np.where(labelled.true, 1.0, -1.0)

    def cost(parameters: Floats) -> tuple[float, Floats]:
        logit = sign * (parameters[0] + scaled @ parameters[1:])
        # Derivative of the log loss by the log odds; expit and log_expit do not overflow.
        slope = -sign * expit(-logit)
        gradient = np.append(slope.sum(), scaled.T @ slope + parameters[1:] / RIDGE**2)
        return float(
            -log_expit(logit).sum() + 0.5 * (parameters[1:] ** 2).sum() / RIDGE**2
        ), gradient

    # More support can never make a statement less probable: bounds keep each weight's sign whatever
    # the sample.
    bounds = [
        (None, None),
        *((0.0, None) if feature.sign > 0 else (None, 0.0) for feature in FEATURES),
    ]
    fit = minimize(cost, np.zeros(1 + len(FEATURES)), jac=True, method="L-BFGS-B", bounds=bounds).x
    weights = fit[1:] / spread
    return float(fit[0] - weights @ middle), np.asarray(weights)


def judge(labelled: Labelled, probability: Floats) -> dict[str, float]:
    """Figures about the probabilities (n,) of statements that were not used for the fit."""
    stated = probability >= STATED_PROBABILITY
    right = np.where(labelled.true, probability, 1.0 - probability)
    return {
        "statements": len(labelled.true),
        "true": int(labelled.true.sum()),
        "calibration_error": round(calibration_error(probability, labelled.true), 4),
        "log_score": round(float(np.mean(np.log(np.maximum(right, PROBABILITY_FLOOR)))), 4),
        "stated": int(stated.sum()),
        "wrong_of_these": int((~labelled.true[stated]).sum()),
    }


def calibrate(sources: Sequence[Path]) -> dict[str, Any]:
    """Content of calibration.json from finished benchmarks and files of statements."""
    read = [read_statements(source) for source in sources]
    statements = [statement for _, listed in read for statement in listed]
    in_fit = list_fitted_cases(statements)
    content: dict[str, Any] = {"format": FORMAT, "benchmarks": [words for words, _ in read]}
    for kind in ("effect", "family"):
        labelled = label(statements, kind)
        fitted, others = (
            labelled.select(np.isin(labelled.case, in_fit, invert=invert))
            for invert in (False, True)
        )
        if not len(fitted.true) or not len(others.true):
            raise BadInput(
                f"all statements of kind {kind!r} are about one half of the cases; run "
                "rfca-rig prove with more cases"
            )
        intercept, weights = fit_weights(fitted)
        probability = expit(intercept + others.features @ weights)
        # Half of the cases are few; once a fit to them is judged, the other half makes the weights
        # better.
        intercept, weights = fit_weights(labelled)
        content[kind] = {
            "intercept": round(intercept, 4),
            "weights": {
                feature.name: round(float(weight), 4)
                for feature, weight in zip(FEATURES, weights, strict=True)
            },
            "statements": len(labelled.true),
            "true": int(labelled.true.sum()),
            "other_half": {
                "all": judge(others, probability),
                **{
                    str(rig): judge(
                        others.select(others.rig == rig), probability[others.rig == rig]
                    )
                    for rig in np.unique(others.rig)
                },
            },
        }
    return content


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        description="Calibrates the probabilities of statements on finished benchmarks."
    )
    parser.add_argument(
        "sources", type=Path, nargs="+", help="folders of rfca-rig prove, or files of statements"
    )
    parser.add_argument("--out", type=Path, required=True, help="calibration.json")
    arguments = parser.parse_args()
    try:
        content = calibrate(arguments.sources)
        write_atomically(arguments.out, (json.dumps(content, indent=1) + "\n").encode())
    except RigError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    print(
        json.dumps({kind: content[kind]["other_half"] for kind in ("effect", "family")}, indent=1)
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
