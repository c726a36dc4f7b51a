"""Does the band of the torque-rotation curve hold the truth, and are the remarks on hinges true?

Run: python -m tests.benchmarks.torque_rotation [--seeds 20] [--first 0] [--drawn]

Legs with cubic, softening and hardening springs stand in MuJoCo's equilibria and are seen by a
camera, their marks glued to 0.1 mm. A line for each law, then for legs with one hinge that is 10 %
softer or rests 2 degrees elsewhere. `--drawn` draws the photos and finds the marks in them, which
takes some 10 s for each leg instead of a second.
"""

import argparse
from collections.abc import Callable, Sequence

import numpy as np

from rfca_rig.analysis.torque_rotation.static_result import StaticResult, remarks
from rfca_rig.errors import RigError
from tests.analysis.torque_rotation.photographed import (
    HINGES,
    LAWS,
    Floats,
    Leg,
    find_curve,
    photograph,
    plain_leg,
    share_inside_band,
    share_inside_stiffness_band,
    stand,
    true_values,
)

# Parts of remarks on single hinges and their marks.
ON_HINGES = ("than the curve of all", "as if it rests", "as if they rest", "of hinge")
SOFTER = 0.9
REST_DEG = 2.0
# A leg whose truth is inside the band over this share of its range counts.
ENOUGH_OF_RANGE = 0.9


def evaluate_seed(
    make_leg: Callable[[np.random.Generator], Leg], seed: Sequence[int], drawn: bool
) -> tuple[Leg, StaticResult | None, Floats, Floats]:
    """The leg of a seed, its curve, and errors and stated deviations (stages, hinges) of its
    angles in degrees; no curve where the stages determine none.
    """
    random = np.random.default_rng(seed)
    leg = make_leg(random)
    stages = stand(leg, random)
    measured, _ = photograph(stages, random, drawn=drawn)
    errors_deg = np.array([stage.hinge_deg for stage in measured]) - [
        stage.hinge_deg for stage in stages
    ]
    stated_deg = np.array([stage.hinge_std_deg for stage in measured])
    try:
        result = find_curve(measured)
    except RigError as error:
        print(f"seed {seed}: {error}")
        result = None
    return leg, result, errors_deg, stated_deg


def remarks_on_hinges(result: StaticResult) -> list[str]:
    """The remarks on single hinges and on their marks."""
    texts = []
    for text in remarks(result):
        if any(part in text for part in ON_HINGES):
            texts.append(text)
    return texts


def root_mean_square(values: Floats) -> float:
    """Of those that are known."""
    return float(np.sqrt(np.nanmean(values**2)))


def measure_law(law: str, seeds: range, drawn: bool) -> None:
    """A line about legs whose hinges all follow the law."""
    inside = []
    inside_stiffness = []
    widths = []
    medians = []
    values = []
    stds = []
    held = 0
    errors = []
    stated = []
    remarked = []
    for seed in seeds:
        _, result, errors_deg, stated_deg = evaluate_seed(
            lambda _: plain_leg(law), (list(LAWS).index(law), seed), drawn
        )
        errors.append(errors_deg)
        stated.append(stated_deg)
        if result is None:
            inside.append(0.0)
            continue
        torque, std = result.curve.torque_Nm(result.curve.grid_rad())
        half = 100.0 * result.curve.reach * std / np.abs(torque).max()
        inside.append(share_inside_band(result, law))
        inside_stiffness.append(share_inside_stiffness_band(result, law))
        widths.append(half.max())
        medians.append(np.median(half))
        held += result.form.holds
        v = result.values
        k0, k2 = true_values(result, law)
        values.append(
            (
                abs(v.k0_Nm_per_rad - k0) <= v.reach * v.k0_std,
                abs(v.k2_per_rad2 - k2) <= v.reach * v.k2_std,
            )
        )
        stds.append((v.k0_std, v.k2_std))
        remarked += [f"    seed {seed}: {text}" for text in remarks_on_hinges(result)]
    k0_inside, k2_inside = np.mean(values, axis=0)
    k0_std, k2_std = np.median(stds, axis=0)
    true_deg = root_mean_square(np.concatenate(errors))
    stated_deg = root_mean_square(np.concatenate(stated))
    print(
        f"{law:16s} truth inside over {ENOUGH_OF_RANGE:.0%} of the range in "
        f"{np.mean(np.array(inside) >= ENOUGH_OF_RANGE):.0%} of {len(seeds)} legs, inside over "
        f"{np.mean(inside):.1%} on average, the stiffness over "
        f"{np.mean(inside_stiffness):.1%}; half band {np.mean(medians):.3f} % of the largest "
        f"torque (median), {np.mean(widths):.3f} % (widest); law accepted {held} times; "
        f"k0 inside {k0_inside:.0%} (std {k0_std:.3f}), k2 inside {k2_inside:.0%} "
        f"(std {k2_std:.3f}); angles err by {true_deg:.3f} deg, stated {stated_deg:.3f}, "
        f"ratio {stated_deg / true_deg:.2f}; {len(remarked)} false remarks",
        flush=True,
    )
    for line in remarked:
        print(line)


def odd_leg(random: np.random.Generator, softer: float, rest_deg: float) -> Leg:
    """A leg with the cubic law, of which one hinge is this stiff and rests there."""
    plain = plain_leg("cubic")
    stiffness = plain.stiffness.copy()
    rest_rad = plain.rest_rad.copy()
    hinge = random.integers(HINGES)
    stiffness[hinge] = softer
    rest_rad[hinge] = np.radians(rest_deg) * random.choice([-1.0, 1.0])
    return Leg("cubic", stiffness, rest_rad)


def measure_odd_hinge(softer: float, rest_deg: float, seeds: range, drawn: bool) -> None:
    """A line about legs with one odd hinge: how often the remarks are on it."""
    right = 0
    wrong = []
    for seed in seeds:
        leg, result, _, _ = evaluate_seed(
            lambda random: odd_leg(random, softer, rest_deg), (len(LAWS), seed), drawn
        )
        if result is None:
            continue
        odd = np.abs(leg.stiffness - 1.0) + np.abs(leg.rest_rad)
        name = f"inge {int(np.argmax(odd)) + 2} "
        texts = remarks_on_hinges(result)
        right += any(name in text for text in texts)
        wrong += [f"    seed {seed}: {text}" for text in texts if name not in text]
    print(
        f"one hinge {softer:.0%} as stiff, resting at {rest_deg:g} deg: remarked in {right} of "
        f"{len(seeds)} legs; {len(wrong)} remarks on other hinges",
        flush=True,
    )
    for line in wrong:
        print(line)


def main() -> None:
    """Prints the lines."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--drawn", action="store_true")
    parser.add_argument("--laws", nargs="*", default=list(LAWS), choices=list(LAWS))
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.seeds)
    for law in asked.laws:
        measure_law(law, seeds, asked.drawn)
    if not asked.drawn:
        measure_odd_hinge(SOFTER, 0.0, seeds, asked.drawn)
        measure_odd_hinge(1.0, REST_DEG, seeds, asked.drawn)


if __name__ == "__main__":
    main()
