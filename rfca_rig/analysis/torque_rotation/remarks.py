"""Warnings on a curve that a reader needs before using it, in sentences."""

import numpy as np

from rfca_rig.analysis.torque_rotation.static_result import StaticResult
from rfca_rig.description.sections import MIN_K2_PER_RAD2

# Limits above which a warning is given.
MUCH_HINGE_DEG = 0.6  # of a hinge angle in a photo
MUCH_FORCE = 1.0  # times the noise of one sample, for a mean of many
MUCH_STATED = 2.0
MUCH_WIDENED = 1.5
MOST_STRAYS = 3


def remarks(result: StaticResult) -> list[str]:
    """Warnings on the form, then on the instruments, then on single hinges and values; empty where there are none."""
    return [
        *_form(result),
        *_loop(result),
        *_strays(result),
        *_noise(result),
        *_hinges(result),
        *_rests(result),
        *_implausible_values(result),
        *_stages(result),
    ]


def _form(result: StaticResult) -> list[str]:
    form, sentences = result.form, []
    if not form.holds:
        sentences.append(
            f"The law k0 (phi + k2 phi^3) does not hold: splines fit better than chance allows (chi2 lower by {form.gain:.0f} for "
            f"{form.more} more numbers), and part from it by {abs(form.apart_Nm):.2f} N m, "
            f"{abs(100 * form.apart_relative):.1f} % of the largest torque, at {abs(np.degrees(form.at_rad)):.0f} degrees. "
            "The curve shown is that of the splines; k0 and k2 are only the nearest."
        )
    if result.values.k2_per_rad2 < 0.0:
        sentences.append(_softens(result))
    if result.not_monotone:
        sentences.append(f"No model can take the measured curve: {result.not_monotone}.")
    return sentences


def _softens(result: StaticResult) -> str:
    k2 = result.values.k2_per_rad2
    if k2 >= MIN_K2_PER_RAD2:
        return f"The hinges soften: k2 is {k2:.3f} 1/rad2, below zero."
    return (
        f"The hinges soften: k2 is {k2:.3f} 1/rad2, and a law below {MIN_K2_PER_RAD2:.3f} falls before 90 degrees; take the measured curve."
    )


def _loop(result: StaticResult) -> list[str]:
    loop = result.loop
    if loop is None or not loop.seen:
        return []
    if loop.half_Nm < 0.0:
        return [
            f"Hinges that turned back bear {-2 * loop.half_Nm:.3f} N m more than before: no friction does that; had the stages settled?"
        ]
    return [
        f"The hinges have a loop: unbending they bear {2 * loop.half_Nm:.3f} N m less than bending. The curve runs through its middle; "
        "turning back only a little, a hinge shows part of its loop."
    ]


def _noise(result: StaticResult) -> list[str]:
    errors, data, sentences = result.found.errors, result.data, []
    if (data.unstated & data.seen).any() and np.degrees(errors.hinge_std_rad) > MUCH_HINGE_DEG:
        sentences.append(
            f"Hinge angles scatter by {np.degrees(errors.hinge_std_rad):.2f} degrees about any one curve, more than photos should."
        )
    if errors.stated_factor > MUCH_STATED:
        sentences.append(f"Hinge angles scatter {errors.stated_factor:.1f} times as much as was stated of them.")
    # The median stage stands for all: a single one with a large stated error does not count.
    over = errors.force_factor * float(np.median(data.force_std[:, 1] / data.sample_noise[1]))
    if over > MUCH_FORCE:
        sentences.append(
            f"Forces and angles do not go together: the mean forces would have to err by {over:.1f} times the noise of one sample. "
            "Something beyond one curve for all hinges is at work; the interval does not cover it."
        )
    if result.repeats.widened > MUCH_WIDENED:
        sentences.append(
            f"The recordings differ more than their errors allow; the interval is {result.repeats.widened:.1f} times wider for that."
        )
    return sentences


def _strays(result: StaticResult) -> list[str]:
    sentences = [
        f"In {stray.label} {stray.says} reads {stray.off:+.2g} {stray.unit} from what balance asks for: look at it again, or leave it out."
        for stray in result.strays[:MOST_STRAYS]
    ]
    more = len(result.strays) - len(sentences)
    return sentences + ([f"So do {more} more readings."] if more else [])


def _hinges(result: StaticResult) -> list[str]:
    return [
        f"Hinge {check.hinge} is {abs(100 * check.stiffer):.1f} +- {100 * check.std:.1f} % {'stiffer' if check.stiffer > 0 else 'softer'} "
        "than the curve of all, which it bends towards itself."
        for check in result.hinges
        if check.is_significant
    ]


def _rests(result: StaticResult) -> list[str]:
    """The most significant departure alone: one hinge that rests elsewhere also shifts the mean of all, and the other way round."""
    checks = [check for check in result.rest_checks if check.is_significant]
    if not checks:
        return []
    clearest = max(checks, key=lambda check: abs(check.rest_rad) / check.std_rad)
    which = "All hinges look as if they rest" if clearest.hinge is None else f"Hinge {clearest.hinge} looks as if it rests"
    return [
        f"{which} at {np.degrees(clearest.rest_rad):+.2f} +- {np.degrees(clearest.std_rad):.2f} degrees from the nominal value; with "
        "rest_angle_deg in [known_to] the rest angles are found together with the curve."
    ]


def _implausible_values(result: StaticResult) -> list[str]:
    return [
        f"The {found.says} would be {found.value:+.3g} {found.unit} from the nominal value, whose standard uncertainty is "
        f"{found.prior_std:.2g} {found.unit}. Measure it again."
        for found in result.systematic_errors
        if found.is_implausible
    ]


def _stages(result: StaticResult) -> list[str]:
    left = result.data.left_out
    sentences = [f"Stage {one.stage.stage} at {1e3 * one.stage.height_m:g} mm is left out: {one.why}." for one in left]
    if result.rig.effects:
        names = ", ".join(effect.id for effect in result.rig.effects)
        sentences.append(f"The nominal effects ({names}) are not taken out of angles and forces.")
    return sentences
