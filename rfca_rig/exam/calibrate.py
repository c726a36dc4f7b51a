"""Fits the probabilities of statements to benchmark cases: python -m rfca_rig.exam.calibrate FOLDER... --out calibration.json

Every FOLDER is a finished benchmark (`rfca-rig prove`). Each diagnosis in it holds the support of the effects and families of its best
explanation. The truths are opened, and give the label of each. A benchmark that was used for the fit cannot judge the result: use other
seeds for that.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, log_expit

from rfca_rig.diagnosis.decision.calibration import FEATURES, FORMAT, features_in
from rfca_rig.errors import BadInput, RigError
from rfca_rig.exam.answer import parse_truth
from rfca_rig.exam.claims import calibration_error, is_true
from rfca_rig.exam.examine import DIAGNOSES
from rfca_rig.exam.sealing import open_all, read_plan
from rfca_rig.recording.atomic import write_atomically

Floats = NDArray[np.float64]

# Prior standard deviation of a weight, per standard deviation of its feature.
RIDGE = 1.0
FOLDS = 10


@dataclass(frozen=True)
class Labelled:
    """Statements of one kind: features (n, f), whether each is true (n,), and the case of each (n,)."""

    features: Floats
    true: NDArray[np.bool_]
    case: NDArray[np.str_]


def read_labelled(folders: Sequence[Path], kind: str) -> Labelled:
    """Read all statements of a kind ("effect" or "family") in finished benchmarks.

    Raises
    ------
    BadInput
        Where the folders hold no statement of this kind.
    """
    features, true, case = [], [], []
    for folder in folders:
        for truth in open_all(folder):
            path = folder / DIAGNOSES / truth["case"] / "diagnosis.json"
            if not path.is_file():
                continue
            for one in json.loads(path.read_text(encoding="utf-8")).get("support", ()):
                if one["kind"] == kind:
                    features.append(features_in(one["values"]))
                    true.append(is_true(kind, {one["id"], *one.get("cannot_tell_from", ())}, parse_truth(truth)))
                    case.append(f"{folder.name}/{truth['case']}")
    if not features:
        raise BadInput(f"{', '.join(map(str, folders))}: no diagnosis with support for a calibration; run rfca-rig prove first")
    return Labelled(np.array(features), np.array(true), np.array(case))


def fit_weights(labelled: Labelled) -> tuple[float, Floats]:
    """Fit a logistic regression by maximum a posteriori; each weight has the sign of its feature.

    Returns
    -------
    intercept : float
        Log odds at zero features; its prior is flat.
    weights : (f,) array
        Per unit of each feature. Their prior is normal, with RIDGE per standard deviation of the feature.
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
        return float(-log_expit(logit).sum() + 0.5 * (parameters[1:] ** 2).sum() / RIDGE**2), gradient

    # More support can never make a statement less probable: bounds keep each weight's sign whatever the sample.
    bounds = [(None, None), *((0.0, None) if feature.sign > 0 else (None, 0.0) for feature in FEATURES)]
    fit = minimize(cost, np.zeros(1 + len(FEATURES)), jac=True, method="L-BFGS-B", bounds=bounds).x
    weights = fit[1:] / spread
    return float(fit[0] - weights @ middle), np.asarray(weights)


def cross_validate(labelled: Labelled) -> Floats:
    """Probability (n,) of each statement from a fit to the other folds."""
    # Statements of one case depend on each other, so a case is never in two folds.
    cases = np.unique(labelled.case)
    fold_of = dict(zip(cases.tolist(), np.arange(len(cases)) % FOLDS, strict=True))
    fold = np.array([fold_of[case] for case in labelled.case.tolist()])
    probability = np.full(len(fold), 0.5)
    for number in range(FOLDS):
        held_out = fold == number
        if held_out.any() and not held_out.all():
            intercept, weights = fit_weights(Labelled(labelled.features[~held_out], labelled.true[~held_out], labelled.case[~held_out]))
            probability[held_out] = expit(intercept + labelled.features[held_out] @ weights)
    return probability


def _describe(folder: Path) -> str:
    diagnosed = len(list((folder / DIAGNOSES).glob("*/diagnosis.json")))
    return f"{read_plan(folder).words}, {diagnosed} of them diagnosed"


def calibrate(folders: Sequence[Path]) -> dict[str, Any]:
    """Content of calibration.json from finished benchmarks."""
    content: dict[str, Any] = {"format": FORMAT, "benchmarks": [_describe(folder) for folder in folders]}
    for kind in ("effect", "family"):
        labelled = read_labelled(folders, kind)
        intercept, weights = fit_weights(labelled)
        probability = cross_validate(labelled)
        stated = probability >= 0.8
        content[kind] = {
            "intercept": round(intercept, 4),
            "weights": {feature.name: round(float(weight), 4) for feature, weight in zip(FEATURES, weights, strict=True)},
            "statements": len(labelled.true),
            "true": int(labelled.true.sum()),
            "cross_validated": {
                "calibration_error": round(calibration_error(probability, labelled.true), 4),
                "log_score": round(float(np.mean(np.log(np.where(labelled.true, probability, 1.0 - probability)))), 4),
                "stated_at_0.8": int(stated.sum()),
                "wrong_of_these": int((~labelled.true[stated]).sum()),
            },
        }
    return content


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description="Calibrates the probabilities of statements on finished benchmarks.")
    parser.add_argument("folders", type=Path, nargs="+", help="folders of rfca-rig prove")
    parser.add_argument("--out", type=Path, required=True, help="calibration.json")
    arguments = parser.parse_args()
    try:
        content = calibrate(arguments.folders)
        write_atomically(arguments.out, (json.dumps(content, indent=1) + "\n").encode())
    except RigError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    print(json.dumps({kind: content[kind]["cross_validated"] for kind in ("effect", "family")}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
