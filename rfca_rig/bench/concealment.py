"""A concealed effect of the twin: drawn, sealed into the rig file, opened afterwards.

The twin has it, and its nominal model lacks it. The rig file holds it sealed: not readable at a
glance, and with a hash, so that it is not changed by accident. It is no secret from somebody who
wants to know.
"""

import base64
import binascii
import hashlib
import json
import re
import zlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rfca_rig.bench.leg_plant import set_up_mechanics
from rfca_rig.description.rig_file import RigFile
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.escaping import toml_string
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.effect import Effect, Parameter
from rfca_rig.model.parameters import PresentEffect, RigModel
from rfca_rig.model.stroke import simulate_stroke_at_speed

HASH_DIGITS = 12
# Places whose effects the twin's mechanics have. Drive and sensor are twins of their own.
PLACES = ("hinges", "one hinge", "tip", "one link", "ground", "rig", "surroundings")
# Sizes are drawn between these shares of a range on a log scale, or of the way from its middle to
# an end: not so small that no recording would show them, not so large that they are plain to see.
SHARES = (0.4, 0.75)
# Strokes of the paper that have to show it: height in mm and speed in rad/s.
SHOWN_BY = ((215.0, 2.433), (235.0, 3.276))
# Rms by which fz changes in one of them, in N: twenty times what noise and scatter of five repeats
# leave there, and less than a fifth of the valley. From 0.5 N on, one of twelve was not found.
LEAST_N = 1.0
MOST_N = 8.0
STEP_S = 1e-3
# Sizes that are drawn of an effect before another one is taken.
DRAWS = 20
HEAD = """\
# The twin of the paper's leg with an effect that its nominal model lacks, sealed under [twin]:
# rfca-rig diagnose RUN --reveal opens it after the diagnosis. The drive follows every command.

"""
# Gains of the twin's speed loop with which its shaft counts as following its command: in twelve
# campaigns it was 0.4 deg off at most.
STIFF_DRIVE = {"speed_gain_Nm_s_per_rad": 60.0, "integral_gain_Nm_per_rad": 2000.0}


def draw_concealed(rig: RigFile, random: np.random.Generator) -> PresentEffect:
    """An effect that strokes of this rig would show: every effect that the twin can have is as
    probable, whatever share of its sizes shows.

    Raises BadInput where no draw shows.
    """
    model = rig.model()
    candidates = [effect for effect in catalogue().values() if _has_place(effect, model)]
    for number in random.permutation(len(candidates)):
        for _ in range(DRAWS):
            drawn = _draw_sizes(candidates[number], random)
            if LEAST_N <= _measure_change(model, drawn) <= MOST_N:
                return drawn
    raise BadInput("[twin]: no effect of the catalogue would show in strokes of this rig")


def _has_place(effect: Effect, model: RigModel) -> bool:
    """Whether the twin's mechanics can have it, as part of the leg or its surroundings, and
    whether it is more than the wrong value of a nominal parameter.
    """
    is_present = effect.id in {present.id for present in model.effects}
    has_spline = effect.needs_k2 and bool(model.leg.torque_splines)
    return (
        effect.where in PLACES
        and not effect.same_as
        and not effect.needs_order
        and not effect.begins
        and not is_present
        and not has_spline
    )


def _draw_sizes(effect: Effect, random: np.random.Generator) -> PresentEffect:
    values = [(p.name, _draw_size(p, random)) for p in effect.parameters]
    neutral = [(p.name, p.neutral) for p in effect.shape]
    return PresentEffect(effect.id, (*values, *neutral))


def _draw_size(parameter: Parameter, random: np.random.Generator) -> float:
    if parameter.whole:
        return float(random.integers(int(parameter.low), int(parameter.high) + 1))
    share = random.uniform(*SHARES)
    if parameter.low > 0.0:
        return float(parameter.low * (parameter.high / parameter.low) ** share)
    middle = 0.5 * (parameter.low + parameter.high)
    side = float(random.choice((-1.0, 1.0)))
    return middle + side * share * 0.5 * (parameter.high - parameter.low)


def _measure_change(model: RigModel, drawn: PresentEffect) -> float:
    """Largest rms change of fz, in N, up to the valley, in the strokes of SHOWN_BY; infinite where
    the twin cannot have the effect.
    """
    changed = replace(model, effects=(*model.effects, drawn))
    changes = []
    for height_mm, speed_rad_s in SHOWN_BY:
        t_s = np.arange(0.0, 2.6 / speed_rad_s, STEP_S)
        try:
            set_up_mechanics(changed, 1e-3 * height_mm, model.leg.start_angle_rad)
            forces = [
                simulate_stroke_at_speed(rig, 1e-3 * height_mm, speed_rad_s, t_s).fz_N
                for rig in (model, changed)
            ]
        except (SimulationFailed, BadInput):
            return float("inf")
        valley = int(np.argmin(forces[0]))
        changes.append(float(np.sqrt(np.mean((forces[1] - forces[0])[:valley] ** 2))))
    return max(changes)


def conceal(rig_file: str, effect: PresentEffect) -> str:
    """The text of a twin's rig file with this effect in it, and a drive that follows every
    command.
    """
    text = HEAD + rig_file[rig_file.index("[rig]") :]
    for key, value in STIFF_DRIVE.items():
        text = re.sub(rf"(?m)^{key} = .*$", f"{key} = {value:g}", text)
    return text.replace("[twin]\n", f"[twin]\nconcealed = {toml_string(seal([effect]))}\n", 1)


def seal(effects: Sequence[PresentEffect]) -> str:
    """The effects as one word of a rig file."""
    content = json.dumps([[effect.id, list(effect.values)] for effect in effects]).encode()
    packed = base64.urlsafe_b64encode(zlib.compress(content, 9)).decode()
    return f"{hashlib.sha256(content).hexdigest()[:HASH_DIGITS]}-{packed}"


def open_seal(sealed: str) -> tuple[PresentEffect, ...]:
    """The effects of a seal; none of an empty one. Raises BadInput where it is damaged."""
    if not sealed:
        return ()
    digest, _, packed = sealed.partition("-")
    try:
        content = zlib.decompress(base64.urlsafe_b64decode(packed))
        is_whole = hashlib.sha256(content).hexdigest()[:HASH_DIGITS] == digest
        effects = []
        for effect_id, values in json.loads(content):
            sizes = tuple((str(name), float(value)) for name, value in values)
            effects.append(PresentEffect(effect_id, sizes))
    except (binascii.Error, zlib.error, ValueError, TypeError):
        is_whole = False
    if not is_whole:
        raise BadInput(
            "[twin] concealed: is not what rfca-rig twin conceal wrote; make the rig file again"
        )
    return tuple(effects)
