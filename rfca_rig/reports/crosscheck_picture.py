"""Figure of the cross-check: contact force of the model and of MuJoCo for each condition, with the difference below on its own scale."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rfca_rig.analysis.crosscheck import CheckedCondition
from rfca_rig.reports.style import MEASURED, SIMULATED, check_picture_path, drawing, save_picture

COLUMN_IN, HEIGHT_IN = 3.3, 3.6


def write_crosscheck_picture(checked: Sequence[CheckedCondition], path: Path) -> None:
    """Writes a picture of the checked conditions to `path`, whose ending decides the format. Raises BadInput where that fails."""
    # The ending is checked before anything is drawn.
    check_picture_path(path)
    with drawing():
        # A fixed salt makes ids in the SVG, and so its bytes, the same each time; fonttype "none" keeps text as text.
        mpl.rcParams.update({"svg.hashsalt": "crosscheck", "svg.fonttype": "none"})
        figure = Figure(figsize=(COLUMN_IN * len(checked), HEIGHT_IN), layout="constrained")
        axes = figure.subplots(2, len(checked), squeeze=False, sharex="col", sharey="row", height_ratios=(2.2, 1.0))
        for column, one in zip(axes.T, checked, strict=True):
            _draw(column[0], column[1], one)
        axes[0, 0].set_ylabel("contact force (N)")
        axes[1, 0].set_ylabel("difference (N)")
        axes[0, 0].legend(frameon=False, fontsize=8.2)
        save_picture(figure, path)


def _draw(force: Axes, difference: Axes, one: CheckedCondition) -> None:
    t_s = one.ours.t_s
    force.plot(t_s, one.contact_N, color=SIMULATED, lw=2.8, label="this model")
    force.plot(t_s, one.theirs.normal_N, color=MEASURED, lw=0.7, label="MuJoCo")
    force.set_title(f"{one.label}: {one.stroke_pct:.2g} %", fontsize=9.2)
    difference.plot(t_s, one.contact_N - one.theirs.normal_N, color=MEASURED, lw=0.6)
    difference.set_xlabel("time from the start of the motion (s)")
    # Only the contact is of interest: the axis shows it with 50 ms on either side.
    touching = t_s[(one.contact_N > 0.0) | (one.theirs.normal_N > 0.0)]
    force.set_xlim(float(np.min(touching)) - 0.05, float(np.max(touching)) + 0.05)
