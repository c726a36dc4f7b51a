"""Converts a figure to inline SVG: no document of its own, no namespaces, no ids that two figures of a page could share."""

import io
import re

import matplotlib as mpl
from matplotlib.figure import Figure

from rfca_rig.report.svg_paths import compress_paths

# Decimals of a coordinate in points: 1/720 inch, finer than any screen or printer shows at this size.
DECIMALS = 1


def inline_svg(figure: Figure, salt: str, label: str) -> str:
    """The figure as an <svg> element. The same figure and `salt` give the same bytes.

    Parameters
    ----------
    figure
        The figure to convert.
    salt
        Seed of the ids of clip paths and markers; it must differ between the figures of one page.
    label
        Description for screen readers, escaped for an attribute.
    """
    drawn = io.StringIO()
    # fonttype "none" keeps text as text, which can be searched and takes fewer bytes. No date, so that the bytes are reproducible.
    with mpl.rc_context({"svg.hashsalt": salt, "svg.fonttype": "none"}):
        figure.savefig(drawn, format="svg", transparent=True, metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    svg = drawn.getvalue()
    size = re.search(r'viewBox="[^"]*"', svg)
    body = svg[svg.index(">", svg.index("<svg")) + 1 :]
    box = size.group(0) if size else ""
    return f'<svg {box} role="img" aria-label="{label}">{compress_paths(_slim(body))}'.strip()


def _slim(body: str) -> str:
    body = re.sub(r"<metadata>.*?</metadata>|<defs>\s*<style.*?</style>\s*</defs>|<!--.*?-->", "", body, flags=re.DOTALL)
    body = re.sub(r'<g id="[^"]*"', "<g", body).replace("xlink:href", "href")
    # The page's style sheet sets the font; only its size stays with the text.
    body = re.sub(r"font-family: [^;\"]*;?|font: ([\d.]+px) [^;\"]*", lambda m: f"font-size: {m[1]}" if m[1] else "", body)
    body = re.sub(r'(?<= d=")[^"]*', lambda path: _round_coordinates(path[0]), body)
    return re.sub(r"\s*\n\s*", "\n", body)


def _round_coordinates(path: str) -> str:
    return re.sub(r"-?\d+\.\d+", lambda m: f"{float(m[0]):.{DECIMALS}f}", path)
