"""Makes a figure into a piece of a page: no document of its own, no namespaces, no ids that two figures could share."""

import io
import re

import matplotlib as mpl
from matplotlib.figure import Figure

from rfca_rig.report.svg_paths import with_light_paths

DECIMALS = 1  # of a point, 1/720 inch: finer than any screen or printer shows at this size


def inline_svg(figure: Figure, salt: str, label: str) -> str:
    """The figure as an <svg> element with text as text. The same figure and `salt` give the same bytes; `label` is read to the blind.

    `salt` must differ between the figures of one page: clip paths and markers are named by it.
    """
    drawn = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": salt, "svg.fonttype": "none"}):
        figure.savefig(drawn, format="svg", transparent=True, metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    svg = drawn.getvalue()
    size = re.search(r'viewBox="[^"]*"', svg)
    body = svg[svg.index(">", svg.index("<svg")) + 1 :]
    box = size.group(0) if size else ""
    return f'<svg {box} role="img" aria-label="{label}">{with_light_paths(_slimmed(body))}'.strip()


def _slimmed(body: str) -> str:
    body = re.sub(r"<metadata>.*?</metadata>|<defs>\s*<style.*?</style>\s*</defs>|<!--.*?-->", "", body, flags=re.DOTALL)
    body = re.sub(r'<g id="[^"]*"', "<g", body).replace("xlink:href", "href")
    body = re.sub(r"font-family: [^;\"]*;?|font: ([\d.]+px) [^;\"]*", lambda m: f"font-size: {m[1]}" if m[1] else "", body)
    body = re.sub(r'(?<= d=")[^"]*', lambda path: _rounded(path[0]), body)
    return re.sub(r"\s*\n\s*", "\n", body)


def _rounded(path: str) -> str:
    return re.sub(r"-?\d+\.\d+", lambda m: f"{float(m[0]):.{DECIMALS}f}", path)
