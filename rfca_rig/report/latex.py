"""Text, units and numbers as LaTeX sets them."""

SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': "''",
    **{character: f"\\{character}" for character in "&%$#_{}"},
    "\u00a0": "~",
    "\u2212": "$-$",
    "\u2013": "--",
    "\u2019": "'",
    "\u201c": "``",
    "\u201d": "''",
    "\u2026": r"\ldots{}",
    "\u2192": r"$\to$",
    "±": r"$\pm$",
    "°": r"$^\circ$",
    "²": "$^2$",
    "³": "$^3$",
    "₀": "$_0$",
    "₂": "$_2$",
    "φ": r"$\varphi$",
    "\u03c3": r"$\sigma$",
    "χ": r"$\chi$",
    "·": r"$\cdot$",
}


SYMBOLS = {"|F|": "$|F|$", "fx": "$F_x$", "fy": "$F_y$", "fz": "$F_z$", "tx": "$T_x$", "k0": "$k_0$", "k2": "$k_2$"}


def tex_head(text: str) -> str:
    """A column's name; quantities that the paper has a symbol for by it."""
    return " ".join(SYMBOLS.get(word, tex_text(word)) for word in text.split(" "))


def tex_text(text: str) -> str:
    """Any text, as it reads; letters with accents are left to the document's encoding."""
    return "".join(SPECIAL.get(character, character) for character in text)


def tex_unit(unit: str) -> str:
    """N m/rad with thin spaces; N/m^1.5 with a true exponent."""
    base, _, power = unit.partition("^")
    said = tex_text(base).replace(" ", r"\,")
    return f"{said}$^{{{power}}}$" if power else said


def tex_number(text: str, half: str = "") -> str:
    r"""A number in mathematics, so that its minus is one; with $\pm$ where there is an uncertainty."""
    return rf"${text} \pm {half}$" if half else f"${text}$"
