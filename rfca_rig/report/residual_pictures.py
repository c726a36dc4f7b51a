"""Figures of residuals over position and speed of a joint, where omitted physics shows as a step, a slope or a wave."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rfca_rig.diagnosis.mechanisms.comparison import JointRemainder
from rfca_rig.diagnosis.result import SignalOverlay
from rfca_rig.report.diagnosis_pictures import Picture
from rfca_rig.report.inline_svg import inline_svg
from rfca_rig.report.named_units import name_with_unit, words_and_unit
from rfca_rig.report.small_multiples import BOTTOM_IN, PANEL_IN, WIDTH_IN
from rfca_rig.report.style import FAINT, MEASURED, OTHER, SIMULATED, drawing

Floats = NDArray[np.float64]

# Points of one series in one panel.
MOST_POINTS = 400
LEFT_IN, BETWEEN_IN, RIGHT_IN, TOP_IN = 0.76, 0.32, 0.2, 0.08
POSITION, SPEED = "_position_", "_speed_"


@dataclass(frozen=True)
class _Series:
    """Points of one colour, all (k,)."""

    color: str
    position: Floats
    speed: Floats
    residual: Floats


def draw_signal_residuals(overlays: Sequence[SignalOverlay], with_fit: bool) -> list[Picture]:
    """One picture for each position and each speed: measured minus nominal, and with `with_fit` also measured minus fitted.

    Arrays of the overlays are (m,). A signal that does not belong to a joint has no picture.
    """
    states = {(one.condition, one.signal): one for one in overlays}
    found = []
    for signal in dict.fromkeys(one.signal for one in overlays):
        joint, unit = _split(signal)
        position_name, speed_name = f"{joint}{POSITION}{unit}", f"{joint}{SPEED}{unit}_s"
        here = [one for one in overlays if one.signal == signal]
        if (here[0].condition, position_name) not in states:
            continue
        # A speed that was not recorded is derived from the position.
        positions = [states[one.condition, position_name] for one in here]
        speeds = [states.get((one.condition, speed_name)) for one in here]
        position = np.concatenate([one.measured for one in positions])
        speed = np.concatenate([_speed_of(p) if s is None else s.measured for p, s in zip(positions, speeds, strict=True)])
        residuals = [(OTHER, np.concatenate([one.measured - one.before for one in here]))]
        if with_fit:
            residuals.append((SIMULATED, np.concatenate([one.measured - one.after for one in here])))
        series = [_Series(color, position, speed, residual) for color, residual in residuals]
        found.append(Picture(name_with_unit(signal), _draw(signal, position_name, series), ""))
    return found


def _split(signal: str) -> tuple[str, str]:
    """Joint and unit of its position, from the name of a position or a speed; empty for other signals."""
    for kind in (SPEED, POSITION):
        joint, found, unit = signal.rpartition(kind)
        if found:
            return joint, unit.removesuffix("_s")
    return "", ""


def _speed_of(position: SignalOverlay) -> Floats:
    """Speed (m,) by central differences of the binned position, where no speed was recorded."""
    return np.asarray(np.gradient(position.measured, position.t_s))


def draw_joint_remainders(joints: Sequence[JointRemainder]) -> list[Picture]:
    """One picture for each joint: the torque that the recorded motion requires and the nominal model lacks."""
    found = []
    for one in joints:
        unit = "m" if one.is_slide else "rad"
        name = f"{one.joint} force_N" if one.is_slide else f"{one.joint} torque_Nm"
        series = [_Series(MEASURED, one.position, one.speed, one.remainder)]
        found.append(Picture(name_with_unit(name), _draw(name, f"{one.joint}{POSITION}{unit}", series), ""))
    return found


def _draw(name: str, position: str, series: Sequence[_Series]) -> str:
    """Two panels, over position and over speed; `name` is that of the residual."""
    high_in = BOTTOM_IN + TOP_IN + PANEL_IN
    width_in = (WIDTH_IN - LEFT_IN - BETWEEN_IN - RIGHT_IN) / 2.0
    words, unit = words_and_unit(name)
    of_position, unit_of_position = words_and_unit(position)
    with drawing():
        figure = Figure(figsize=(WIDTH_IN, high_in))
        boxes = [(LEFT_IN + k * (width_in + BETWEEN_IN), BOTTOM_IN, width_in, PANEL_IN) for k in range(2)]
        of_figure = np.array([WIDTH_IN, high_in, WIDTH_IN, high_in])
        left = figure.add_axes((np.array(boxes[0]) / of_figure).tolist())
        right = figure.add_axes((np.array(boxes[1]) / of_figure).tolist(), sharey=left)
        for axes, part in ((left, "position"), (right, "speed")):
            axes.axhline(0.0, color=FAINT, lw=0.6)
            for one in series:
                # Every n-th point, n rounded up: more points only blacken the panel.
                every = max(1, -(-len(one.residual) // MOST_POINTS))
                axes.plot(getattr(one, part)[::every], one.residual[::every], ls="", marker=".", ms=3.4, mew=0.0, color=one.color)
        left.set_ylabel(f"residual ({unit})")
        left.set_xlabel(f"{of_position} ({unit_of_position})")
        right.set_xlabel(f"{of_position.removesuffix('position')}speed ({unit_of_position}/s)")
        right.tick_params(labelleft=False)
        label = f"residual of {words} over position and speed of the joint"
        return inline_svg(figure, f"residual {name}", escape(label, quote=True))
