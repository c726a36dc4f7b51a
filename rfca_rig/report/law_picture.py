"""Small figure of a measured residual law with its uncertainty band, and the law of the catalogue for comparison."""

from html import escape

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rfca_rig.diagnosis.residual_force.law import CatalogueCurve, MeasuredLaw
from rfca_rig.report.inline_svg import inline_svg
from rfca_rig.report.style import ALIKE, FAINT, MEASURED, OTHER, SMALL, drawing

WIDTH_IN, HEIGHT_IN = 4.4, 2.5
# Half width of the band in standard deviations.
BAND = 2.0
DASHES = (0, (3.2, 1.8))
WORDS = {
    "rate_rad_s": "rate of the hinge",
    "angle_rad": "angle of the hinge",
    "speed_rad_s": "speed of the joint",
    "speed_m_s": "speed of the joint",
    "position_rad": "position of the joint",
    "position_m": "position of the joint",
    "spring_torque_Nm": "torque of the spring",
    "slip_m_s": "sliding speed of the tip",
    "load_N": "load on the tip",
    "depth_m": "depth of the tip in the floor",
    "time_s": "time",
    "shaft_angle_rad": "angle of the shaft",
}


def draw_law(law: MeasuredLaw, catalogue_curve: CatalogueCurve | None) -> str:
    """The residual law as inline SVG: its band of two standard deviations, the catalogue's law, and both branches where it has memory."""
    with drawing():
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), layout="constrained")
        axes = figure.subplots()
        _draw(axes, law, catalogue_curve)
        label = f"measured law of {_words(law)} at {law.place} with its band"
        if catalogue_curve is not None:
            label += f", and {catalogue_curve.name} of the catalogue"
        return inline_svg(figure, f"measured law {law.place} {law.argument}", escape(label, quote=True))


def _draw(axes: Axes, law: MeasuredLaw, curve: CatalogueCurve | None) -> None:
    axes.axhline(0.0, color=FAINT, lw=0.5)
    low, high = law.values - BAND * law.std, law.values + BAND * law.std
    axes.fill_between(law.knots, low, high, color=ALIKE, alpha=0.55, lw=0.0, label=f"±{BAND:g} standard deviations")
    if law.memory is not None and law.memory.has_memory:
        axes.plot(law.knots, law.memory.rising, color=MEASURED, lw=0.8, ls=":", label="while it rises, while it falls")
        axes.plot(law.knots, law.memory.falling, color=MEASURED, lw=0.8, ls=":")
    if curve is not None:
        axes.plot(curve.argument, curve.values, color=OTHER, lw=1.3, ls=DASHES, label=curve.name)
    axes.plot(law.knots, law.values, color=MEASURED, lw=1.2, marker="o", ms=2.6, label="measured")
    axes.set_xlabel(f"{_words(law)} ({law.argument_unit})")
    axes.set_ylabel(f"residual ({law.unit})" if law.unit else "change of the friction (share)")
    axes.set_xlim(law.visited)
    axes.legend(frameon=False, fontsize=SMALL, loc="best")


def _words(law: MeasuredLaw) -> str:
    return WORDS.get(law.argument, "reading").replace("hinge", "hinge" if law.place.startswith("hinge") else "joint")
