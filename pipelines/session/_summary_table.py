"""One table of a session for a thesis: a row for each quantity, with the value that it is compared with.

The same frame becomes a sheet of a workbook, a table of LaTeX and one of csv.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Mapping

import pandas as pd

from labpipe.report import number
from labpipe.workflow.results import Results
from pipelines.experiments import KINDS
from pipelines.experiments.shared.comparison_rows import Row, row
from pipelines.session._comparison import compared, labelled, sides
from pipelines.session._export_formats import one_line
from pipelines.session._verdicts import told_verdicts

_FIELDS = {
    "experiment": "experiment", "kind": "kind", "material": "material", "condition": "condition",
    "quantity": "quantity", "unit": "unit", "value": "measured", "u": "u_measured", "n": "n",
    "compared with": "against", "expected": "model", "u of expected": "u_model", "difference": "difference",
    "u of difference": "u_difference", "deviation in u": "deviation", "p": "p", "nRMSE": "nrmse",
}  # fmt: skip
"""Headings, and the fields of a row below them; values are in SI, ``u`` is a standard uncertainty."""

_LATEX = str.maketrans(
    {c: f"\\{c}" for c in "&%$#_{}"}
    | {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "±": r"$\pm$",
       "×": r"$\times$", "−": "$-$", "°": r"$^\circ$", "µ": r"$\mu$", "·": r"$\cdot$", "δ": r"$\delta$", "′": "$'$",
       "″": "$''$", "\N{NO-BREAK SPACE}": "~", "\N{EN DASH}": "--", "\N{EM DASH}": "---"}
    | {power: f"$^{{{digit}}}$" for power, digit in zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-", strict=True)}
)  # fmt: skip


def rows_of(results: Results, experiments: Iterable[str] = ()) -> list[Row]:
    """Gather the quantities of some experiments, or of all, whose results are up to date.

    A key number that is compared with nothing has an empty ``against``.
    """
    wanted = set(experiments) or set(results.experiments)
    found: list[Row] = []
    for name, experiment in results.experiments.items():
        if name not in wanted:
            continue
        own = compared(results, name) or []
        known = {r.measured for r in own}  # a key number may be one of those that are compared
        found += own
        for key in KINDS[experiment.kind].key_numbers:
            dataset = results.first(name, key.stage)
            if dataset is not None and (value := key.within(dataset)) is not None and value[0] not in known:
                pair = (value[0], math.nan if value[1] is None else value[1])
                one = row(key.title, key.unit, 1, against="", measured=pair)
                found.append(labelled(one, experiment, results.plan.session))
    return found


def frame(results: Results, rows: Iterable[Row]) -> pd.DataFrame:
    """Return one line for each quantity, in SI, with the verdict on its experiment; texts are on one line."""
    verdicts = told_verdicts(results.folder)
    cells = [
        {title: getattr(r, name) for title, name in _FIELDS.items()}
        | ({n: getattr(verdicts[r.experiment], n) for n in ("believable", "model")} if r.experiment in verdicts else {})
        for r in rows
    ]
    table = pd.DataFrame(cells, columns=[*_FIELDS, "believable", "model"]).fillna({"believable": "", "model": ""})
    return table.map(lambda value: one_line(value) if isinstance(value, str) else value)


def tex_text(rows: Iterable[Row], table: pd.DataFrame, remarks: Mapping[str, str]) -> str:
    r"""Write the table for LaTeX; it wants ``\usepackage{booktabs}`` and nothing else.

    Each number is rounded to two digits of its uncertainty and has the prefix that its size asks
    for. Curves give their nRMSE.
    """
    body = []
    for r, believable, model in zip(rows, table["believable"], table["model"], strict=True):
        measured, expected, unit = sides(r)
        deviation = "" if r.deviation is None else f"{number(r.deviation, 2)} u"
        if r.nrmse is not None:
            unit, deviation = "", f"nRMSE {number(100 * r.nrmse, 2)} %"
        verdict = ", model ".join(part for part in (believable, model) if part and part != "none")
        quantity = ", ".join(part for part in (r.quantity, r.condition) if part)
        body.append((r.experiment, quantity, unit, measured, expected, deviation, verdict))
    head = ("experiment", "quantity", "unit", "measured", "expected", "deviation", "verdict")
    above = "".join(f"% {key}: {one_line(value)}\n" for key, value in remarks.items())
    titles, *lines = (
        " & ".join(one_line(cell).translate(_LATEX) for cell in cells) + r" \\" + "\n" for cells in (head, *body)
    )
    begin, middle = "\\begin{tabular}{lllllll}\n\\toprule\n", "\\midrule\n"
    return f"{above}{begin}{titles}{middle}{''.join(lines)}\\bottomrule\n\\end{{tabular}}\n"


def xlsx_bytes(table: pd.DataFrame, remarks: Mapping[str, str]) -> bytes:
    """Write a workbook: the table, and a sheet about itself; texts stay texts, those that begin like a formula too."""
    stream = io.BytesIO()
    with pd.ExcelWriter(stream, engine="openpyxl") as book:
        table.to_excel(book, sheet_name="quantities", index=False, freeze_panes=(1, 1))
        pd.DataFrame(remarks.items()).map(one_line).to_excel(book, sheet_name="about", index=False, header=False)
        for cell in (cell for sheet in book.sheets.values() for row in sheet.iter_rows() for cell in row):
            cell.data_type = "s" if cell.data_type == "f" else cell.data_type
    return stream.getvalue()
