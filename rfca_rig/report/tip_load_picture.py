"""Figure of the leg's shape under a tip force, with its shape under its own weight alone."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from rfca_rig.analysis.tip_load import LoadedShape
from rfca_rig.report.picture_file import check_picture_path, save_picture
from rfca_rig.report.style import BAD, FAINT, SIMULATED, SMALL, drawing

WIDTH_IN = 4.6
# Length of the force's arrow, as a share of the leg.
ARROW = 0.3


def write_tip_load_picture(shape: LoadedShape, path: Path) -> None:
    """Writes a picture of the shape to `path`, whose ending decides the format. Raises BadInput where that fails."""
    check_picture_path(path)
    ends, alone = shape.ends_mm, shape.unloaded_mm
    length = float(np.hypot(*np.diff(ends, axis=0).T).sum())
    # The bound avoids a division by zero for no force, where no arrow is drawn.
    arrow = ARROW * length * shape.force_N / max(float(np.hypot(*shape.force_N)), 1e-12)
    visible = np.vstack([ends, alone, ends[-1:] - arrow])
    low, high = visible.min(axis=0) - 0.09 * length, visible.max(axis=0) + 0.09 * length
    with drawing():
        mpl.rcParams.update({"svg.hashsalt": "tip load", "svg.fonttype": "none"})
        figure = Figure(figsize=(WIDTH_IN, WIDTH_IN * (high[1] - low[1]) / (high[0] - low[0]) + 0.7), layout="constrained")
        axes = figure.subplots()
        axes.plot(*alone.T, "--", color=FAINT, lw=1.2, label="weight alone")
        axes.plot(*ends.T, "o-", color=SIMULATED, lw=2.8, ms=4.5, label="under the force")
        for torque, place, before, after in zip(shape.torques_Nm[1:], ends[1:-1], ends[:-2], ends[2:], strict=True):
            # Numbers are placed beside the leg: perpendicular to the line between the neighbouring points.
            across = np.array([before[1] - after[1], after[0] - before[0]])
            away = place - 0.055 * length * across / np.hypot(*across)
            axes.text(float(away[0]), float(away[1]), f"{torque:.2f}", ha="center", va="center", fontsize=SMALL)
        if shape.force_N.any():
            axes.annotate("", xy=tuple(ends[-1]), xytext=tuple(ends[-1] - arrow), arrowprops={"arrowstyle": "-|>", "color": BAD, "lw": 1.6})
            axes.plot([], [], color=BAD, lw=1.6, label=f"{np.hypot(*shape.force_N):.3g} N")
        axes.set_aspect("equal")
        # y counts downwards, as in the model.
        axes.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]), xlabel="along (mm)", ylabel="down (mm)")
        axes.set_title("torques of the hinges in N m", fontsize=SMALL, loc="left")
        axes.legend(frameon=False, fontsize=SMALL)
        save_picture(figure, path)
