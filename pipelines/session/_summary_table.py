"""One table of a session for a thesis: a row for each quantity, with the value that it is compared with.

The same rows become a sheet of a workbook, a table of LaTeX and one of csv.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from labpipe.report import display_unit, number, plus_minus
from labpipe.workflow.results import Results
from pipelines.experiments import KINDS
from pipelines.experiments.shared.comparison_rows import Row, row
from pipelines.session._comparison import compared, labelled
from pipelines.session._export_formats import csv_text, one_line
from pipelines.session._verdicts import told_verdicts

COLUMNS = (
    "experiment", "kind", "material", "condition", "quantity", "unit", "value", "u", "n", "compared with", "expected",
    "u of expected", "difference", "u of difference", "deviation in u", "p", "nRMSE", "believable", "model",
)  # fmt: skip
"""Headings; values are in SI, ``u`` is a standard uncertainty."""

_LATEX = str.maketrans(
    {c: f"\\{c}" for c in "&%$#_{}"}
    | {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "±": r"$\pm$",
       "×": r"$\times$", "−": "$-$", "°": r"$^\circ$", "µ": r"$\mu$", "·": r"$\cdot$", "δ": r"$\delta$", "′": "$'$",
       "″": "$''$", "\N{NO-BREAK SPACE}": "~", "\N{EN DASH}": "--", "\N{EM DASH}": "---"}
    | {power: f"$^{{{digit}}}$" for power, digit in zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-", strict=True)}
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Line:
    """One quantity of one experiment.

    ``row`` is the measured value and the one that it is compared with; of a key number that is compared with
    nothing ``against`` is empty. ``believable`` and ``model`` are the verdict on its experiment, or "".
    """

    row: Row
    believable: str
    model: str

    @property
    def cells(self) -> tuple[Any, ...]:
        """Values in the order of :data:`COLUMNS`; None for those that there are not."""
        r = self.row
        head = (r.experiment, r.kind, r.material, r.condition, r.quantity, r.unit, r.measured, r.u_measured, r.n)
        judged = (r.difference, r.u_difference, r.deviation, r.p, r.nrmse, self.believable, self.model)
        return (*head, r.against, r.model, r.u_model, *judged)


def lines(results: Results, experiments: Iterable[str] = ()) -> list[Line]:
    """Gather the quantities of some experiments, or of all, whose results are up to date."""
    wanted = set(experiments) or set(results.experiments)
    session, verdicts = results.plan.session, told_verdicts(results.folder)
    found = []
    for name, experiment in results.experiments.items():
        if name not in wanted:
            continue
        verdict = (verdicts[name].believable, verdicts[name].model) if name in verdicts else ("", "")
        rows = compared(results, name) or []
        known = {r.measured for r in rows}  # a key number may be one of those that are compared
        for key in KINDS[experiment.kind].key_numbers:
            dataset = results.first(name, key.stage)
            if dataset is not None and (own := key.within(dataset)) is not None and own[0] not in known:
                u = math.nan if own[1] is None else own[1]
                one = row(key.title, key.unit, 1, against="", measured=own[0], u_measured=u)
                rows.append(labelled(one, experiment, session))
        found += [Line(r, *verdict) for r in rows]
    return found


def table_csv(found: Sequence[Line], remarks: Mapping[str, str], decimal: str = ".") -> str:
    """Write the table as csv, values exact and in SI."""
    columns = zip(*(line.cells for line in found), strict=True)
    return csv_text({n: np.array(c, object) for n, c in zip(COLUMNS, columns, strict=True)}, remarks, decimal=decimal)


def tex_text(found: Sequence[Line], remarks: Mapping[str, str]) -> str:
    r"""Write the table for LaTeX; it wants ``\usepackage{booktabs}`` and nothing else.

    Each number is rounded to two digits of its uncertainty and has the prefix that its size asks
    for. Curves give their nRMSE.
    """
    head = ("experiment", "quantity", "unit", "measured", "expected", "deviation", "verdict")
    body = []
    for line in found:
        r = line.row
        shown = display_unit([v for v in (r.measured, r.model, r.difference) if v is not None], r.unit)
        deviation = "" if r.deviation is None else f"{number(r.deviation, 2)} u"
        unit, factor = shown.text, shown.factor
        if r.nrmse is not None:
            unit, factor, deviation = "", 1.0, f"nRMSE {number(100 * r.nrmse, 2)} %"
        verdict = ", model ".join(part for part in (line.believable, line.model) if part and part != "none")
        values = (_shown(r.measured, r.u_measured, factor), _shown(r.model, r.u_model, factor))
        quantity = ", ".join(part for part in (r.quantity, r.condition) if part)
        body.append((r.experiment, quantity, unit, *values, deviation, verdict))
    above = "".join(f"% {key}: {one_line(value)}\n" for key, value in remarks.items())
    titles, *rows = (
        " & ".join(one_line(cell).translate(_LATEX) for cell in cells) + r" \\" + "\n" for cells in (head, *body)
    )
    begin, middle = "\\begin{tabular}{lllllll}\n\\toprule\n", "\\midrule\n"
    return f"{above}{begin}{titles}{middle}{''.join(rows)}\\bottomrule\n\\end{{tabular}}\n"


def _shown(value: float | None, u: float | None, factor: float) -> str:
    if value is None:
        return ""
    return number(value / factor, 4) if not u else plus_minus(value / factor, u / factor)


def xlsx_bytes(found: Sequence[Line], remarks: Mapping[str, str]) -> bytes:
    """Write a workbook: the table, and a sheet about itself; texts stay texts, those that begin like a formula too."""
    cells = ([one_line(v) if isinstance(v, str) else v for v in line.cells] for line in found)
    table = pd.DataFrame(cells, columns=list(COLUMNS))
    stream = io.BytesIO()
    with pd.ExcelWriter(stream, engine="openpyxl") as book:
        table.to_excel(book, sheet_name="quantities", index=False, freeze_panes=(1, 1))
        pd.DataFrame(remarks.items()).map(one_line).to_excel(book, sheet_name="about", index=False, header=False)
        for cell in (cell for sheet in book.sheets.values() for row in sheet.iter_rows() for cell in row):
            cell.data_type = "s" if cell.data_type == "f" else cell.data_type
    return stream.getvalue()
