"""How often the measured valley is in the interval that static stages and [known_to] predict.

Run: python -m tests.benchmarks.paper FOLDER [--legs 20] [--seed 1] [--model-error 0.005]

Each leg is one of the exam's simulator, whose contact law differs from the model's. Its true values
are drawn from the uncertainties that its campaign states: height, start angle, friction, stiffness,
mass, damping, contact stiffness. It has the paper's four conditions, five strokes each, and static
stages. The springs come from the stages, the rest from the nominal values; nothing is fitted to
strokes. --model-error is the size of what the model does not describe at all. The values of one leg
are common to its four conditions, so that the shares of few legs scatter. Answers stay in FOLDER;
the same command goes on.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from rfca_rig.analysis.reproduction import reproduce_strokes
from rfca_rig.analysis.torque_rotation.calibration_file import write_calibration
from rfca_rig.analysis.torque_rotation.evaluate import StageAssumptions, evaluate
from rfca_rig.campaign.opening import open_recordings
from rfca_rig.description.model_file import read_model_file
from rfca_rig.exam.cases import PAPER_CONDITIONS, Case
from rfca_rig.exam.nominal_world import draw_nominal_errors, draw_structured_error
from rfca_rig.exam.simulate_campaign import write_campaign
from rfca_rig.reports.paper.page import summarize


def draw(seed, number, model_error):
    """Leg `number` of a seed, whatever the others are."""
    random = np.random.default_rng([seed, number])
    case = Case(
        id="",
        kind="nothing",
        seed=int(random.integers(2**31)),
        design=PAPER_CONDITIONS,
        off=draw_nominal_errors(random),
    )
    if not model_error:
        return case
    structured = draw_structured_error(model_error, random)
    return replace(case, model_error=model_error, structured=structured)


def predict(folder):
    """The numbers of the page on a campaign's folder."""
    recordings = open_recordings([folder])
    first = recordings[0]
    curve = evaluate(recordings, StageAssumptions(first.nominal, first.known_to))
    write_calibration(folder / "model.toml", curve, first.nominal, first.known_to, ["a campaign"])
    model = read_model_file(folder / "model.toml")
    strokes = [stroke for recording in recordings for stroke in recording.strokes]
    known_to = model.known_to.model_dump(exclude_none=True)
    return summarize(reproduce_strokes(curve, model.model(), known_to, strokes))


def answer(folder, args, number):
    """The stored answer of a leg, made where it is missing."""
    path = folder / f"leg-{number:03d}.json"
    if not path.exists():
        campaign = folder / f"leg-{number:03d}"
        if not campaign.exists():
            write_campaign(draw(args.seed, number, args.model_error), campaign)
        path.write_text(json.dumps(predict(campaign), indent=1), encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--legs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--model-error", type=float, default=0.0)
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    answers = [answer(args.folder, args, number) for number in range(args.legs)]
    for quantity in ("time", "fz"):
        known = [
            row[f"{quantity}_inside"]
            for result in answers
            for row in result["predicted"]
            if row[f"{quantity}_inside"] != "not known"
        ]
        print(f"{quantity}: {known.count('yes')} of {len(known)} inside")
    for name in ("average_time_error_pct", "average_force_error_pct"):
        errors = [result["along_recorded_shaft"][name] for result in answers]
        print(f"{name}: median {np.median(errors):.2f}, largest {max(errors):.2f}")


if __name__ == "__main__":
    main()
