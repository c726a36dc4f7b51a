"""Table II for other programs: JSON as rfca-table2/1, CSV with the same values, LaTeX for a paper."""

import csv
import io
import json
from typing import Any

from rfca_rig.analysis.repeats import Spread
from rfca_rig.analysis.table2 import PAPER_AVERAGE_ERROR_PCT, Row, Table2

FORMAT = "rfca-table2/1"
TEX_SPECIAL = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", **{c: f"\\{c}" for c in "&%$#_{}"}}
RULES = (r"\toprule", r"\midrule", r"\bottomrule")


def as_json(table: Table2) -> str:
    """The document; what is not known is null."""
    average = {
        "time_error_pct": _rounded(table.average_time_error_pct, 4),
        "force_error_pct": _rounded(table.average_force_error_pct, 4),
    }
    document = {"format": FORMAT, "rows": [record(row) for row in table.rows], "average": average}
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def as_csv(table: Table2) -> str:
    """One line a row, columns as the keys in JSON; what is not known is empty."""
    out = io.StringIO()
    nothing = Spread(None, None, 0)
    keys = list(record(Row("", 0.0, 0.0, 0.0, nothing, nothing, None, None, ())))
    writer = csv.DictWriter(out, keys, lineterminator="\n")
    writer.writeheader()
    writer.writerows({**record(row), "refused": "; ".join(row.refused)} for row in table.rows)
    return out.getvalue()


def as_tex(table: Table2) -> str:
    """A tabular in the paper's layout, to be put into a document that loads booktabs."""
    sources = list(dict.fromkeys(row.source for row in table.rows))
    lines = [
        r"% needs \usepackage{booktabs}; valleys are (time in s, fz in N), measured as mean and standard deviation over the repeats",
        r"{\footnotesize\setlength{\tabcolsep}{3.5pt}%",
        r"\begin{tabular}{llllrr}",
        RULES[0],
        r" & & & & \multicolumn{2}{c}{Error (\%)} \\",
        r"\cmidrule(l){5-6}",
        r"Height & Speed (rad/s) & Experimental valley & Simulated valley & time & $F_z$ \\",
    ]
    for source in sources:
        lines += [RULES[1], rf"\multicolumn{{6}}{{l}}{{{_tex_text(source)}}} \\"] if len(sources) > 1 else [RULES[1]]
        lines += [_tex_row(row) for row in table.rows if row.source == source]
    time, force = (_tex_number(value, 2) for value in (table.average_time_error_pct, table.average_force_error_pct))
    lines += [RULES[1], rf"\multicolumn{{4}}{{l}}{{Average}} & {time} & {force} \\", _tex_paper(), RULES[2], r"\end{tabular}}"]
    return "\n".join(lines) + "\n"


def record(row: Row) -> dict[str, Any]:
    """The row by its keys: first those of rfca-table2/1, then what this program adds."""
    return {
        "height_mm": _rounded(1e3 * row.height_m, 3),
        "speed_rad_s": _rounded(row.speed_rad_s, 5),
        "repeats": row.repeats,
        "measured_time_s": _rounded(row.time.mean, 6),
        "measured_time_std_s": _rounded(row.time.std, 6),
        "measured_fz_N": _rounded(row.fz.mean, 4),
        "measured_fz_std_N": _rounded(row.fz.std, 4),
        "simulated_time_s": _rounded(row.simulated_time_s, 6),
        "simulated_fz_N": _rounded(row.simulated_fz_N, 4),
        "time_error_pct": _rounded(row.time_error_pct, 4),
        "force_error_pct": _rounded(row.force_error_pct, 4),
        "signed_time_error_pct": _rounded(row.signed_time_error_pct, 4),
        "signed_force_error_pct": _rounded(row.signed_force_error_pct, 4),
        "shaft_speed_rad_s": _rounded(row.shaft_speed_rad_s, 5),
        "source": row.source,
        "refused": list(row.refused),
    }


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits) + 0.0


def _tex_row(row: Row) -> str:
    measured = rf"({_tex_spread(row.time.mean, row.time.std, 3)}, {_tex_spread(row.fz.mean, row.fz.std, 2)})"
    simulated = f"({_tex_number(row.simulated_time_s, 3)}, {_tex_number(row.simulated_fz_N, 2)})"
    cells = [
        f"{1e3 * row.height_m:g}\\,mm",
        f"{row.speed_rad_s:.3f}",
        measured if row.repeats else "--",
        simulated if row.simulated_time_s is not None else "--",
        _tex_number(row.time_error_pct, 2),
        _tex_number(row.force_error_pct, 2),
    ]
    return " & ".join(cells) + r" \\"


def _tex_spread(mean: float | None, std: float | None, digits: int) -> str:
    return _tex_number(mean, digits) if std is None else f"{_tex_number(mean, digits)} $\\pm$ {std:.{digits}f}"


def _tex_number(value: float | None, digits: int) -> str:
    return "--" if value is None else f"${value:.{digits}f}$"


def _tex_paper() -> str:
    time, force = PAPER_AVERAGE_ERROR_PCT
    return rf"\multicolumn{{4}}{{l}}{{Average in the original paper, its own rig}} & ${time}$ & ${force}$ \\"


def _tex_text(text: str) -> str:
    return "".join(TEX_SPECIAL.get(c, c) for c in text)
