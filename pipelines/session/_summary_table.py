"""One table of a session for a thesis: a row for each quantity, with the value that it is compared with.

The same rows become a sheet of a workbook, a table of LaTeX and one of csv. A workbook has one more
sheet for each family of curves: the results that experiments of one kind have in common.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
import xarray as xr

from labpipe.report import display_unit, number, plus_minus
from labpipe.workflow.plan import READY
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

_MOST_POINTS = 2000
"""Of a curve on a sheet: enough to draw it, and a workbook of a campaign still opens."""
_SHEET_NAME = 31  # characters
_LEAST_CURVE = 20
"""Points that make a curve; shorter variables are in the table or in ``export --format csv``."""
_LATEX = {
    **{c: f"\\{c}" for c in "&%$#_{}"},
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "±": r"$\pm$", "×": r"$\times$", "−": "$-$", "°": r"$^\circ$", "µ": r"$\mu$", "·": r"$\cdot$", "δ": r"$\delta$",
    "′": "$'$", "″": "$''$", "\N{NO-BREAK SPACE}": "~", "\N{EN DASH}": "--", "\N{EM DASH}": "---",
}  # fmt: skip
_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_Curve = tuple[str, str, str, str, Any]
"""A curve on a sheet: experiment, title, unit, the points that are taken, and its values."""


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
            dataset = _dataset(results, name, key.stage)
            if dataset is not None and (own := key.within(dataset)) is not None and own[0] not in known:
                u = math.nan if own[1] is None else own[1]
                one = row(key.title, key.unit, 1, against="", measured=own[0], u_measured=u)
                rows.append(labelled(one, experiment, session))
        found += [Line(r, *verdict) for r in rows]
    return found


def _dataset(results: Results, experiment: str, stage: str) -> xr.Dataset | None:
    wanted = (r for r in results.plan.rows if (r.experiment, r.stage) == (experiment, stage))
    found = next((r for r in wanted if r.recording is None and r.state in READY), None)
    return None if found is None else results.up_to_date(found)


def table_csv(found: Sequence[Line], remarks: Mapping[str, str]) -> str:
    """Write the table as csv, values exact and in SI."""
    columns = zip(*(line.cells for line in found), strict=True)
    return csv_text({n: np.array(c, object) for n, c in zip(COLUMNS, columns, strict=True)}, remarks)


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
    titles, *rows = (" & ".join(map(_latex, cells)) + r" \\" + "\n" for cells in (head, *body))
    begin, middle = "\\begin{tabular}{lllllll}\n\\toprule\n", "\\midrule\n"
    return f"{above}{begin}{titles}{middle}{''.join(rows)}\\bottomrule\n\\end{{tabular}}\n"


def _shown(value: float | None, u: float | None, factor: float) -> str:
    if value is None:
        return ""
    return number(value / factor, 4) if not u else plus_minus(value / factor, u / factor)


def _latex(text: str) -> str:
    powers = re.sub(r"[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+", lambda m: f"\0{m[0].translate(_SUPERSCRIPTS)}\1", one_line(text))
    plain = "".join(_LATEX.get(character, character) for character in powers)
    return plain.replace("\0", "$^{").replace("\1", "}$")


def xlsx_bytes(results: Results, found: Sequence[Line], remarks: Mapping[str, str]) -> bytes:
    """Write a workbook: the table, a sheet for each family of curves, and one about itself.

    Of curves with more than 2,000 points every second, third ... is taken, as their heads say; whole
    ones are in the csv files.
    """
    from openpyxl import Workbook

    book = Workbook(write_only=True)
    sheet = book.create_sheet("quantities")
    sheet.freeze_panes = "B2"
    for cells in (COLUMNS, *(line.cells for line in found)):
        _append(sheet, cells)
    for title, curves in _families(results, list(dict.fromkeys(line.row.experiment for line in found))):
        sheet = book.create_sheet(title)
        sheet.freeze_panes = "A5"
        for head in list(zip(*curves, strict=True))[:4]:
            _append(sheet, head)
        for values in zip_longest(*(curve[4].tolist() for curve in curves)):
            sheet.append([v if v is not None and math.isfinite(v) else None for v in values])
    about = book.create_sheet("about")
    for item in remarks.items():
        _append(about, item)
    stream = io.BytesIO()
    book.save(stream)
    return stream.getvalue()


def _append(sheet: Any, cells: Iterable[Any]) -> None:
    """Add a row whose texts stay texts, those that begin like a formula too."""
    from openpyxl.cell import WriteOnlyCell

    made = []
    for value in cells:
        cell = WriteOnlyCell(sheet, value=one_line(value) if isinstance(value, str) else value)
        if isinstance(value, str):
            cell.data_type = "s"
        made.append(cell)
    sheet.append(made)


def _families(results: Results, names: Sequence[str]) -> Iterator[tuple[str, list[_Curve]]]:
    """Yield the sheets of curves: title, and the columns."""
    kinds: dict[str, list[str]] = {}
    for name in names:
        kinds.setdefault(results.experiments[name].kind, []).append(name)
    for kind, members in kinds.items():
        drawn = KINDS[kind].picture
        stages = {drawn.stage if drawn else "", "model", "comparison"}
        for stage in (s.name for s in KINDS[kind].stages if s.name in stages):
            sheets: dict[str, list[_Curve]] = {}
            for name in members:
                if (dataset := _dataset(results, name, stage)) is not None:
                    shown = drawn.y if drawn is not None and stage == drawn.stage else ""
                    for dim, columns in _curves(name, dataset, shown).items():
                        sheets.setdefault(dim, []).extend(columns)
            for dim, columns in sheets.items():
                yield f"{kind} {stage} {dim}"[:_SHEET_NAME], columns


def _curves(experiment: str, dataset: xr.Dataset, shown: str) -> dict[str, list[_Curve]]:
    """Return the columns of a result by the dimension along which they run, the axis first.

    Variables of one dimension are curves; of more only the one that the overview draws, a column
    for each.
    """
    found: dict[str, list[_Curve]] = {}
    for dim in (str(dim) for dim, size in dataset.sizes.items() if size >= _LEAST_CURVE):
        step = math.ceil(dataset.sizes[dim] / _MOST_POINTS)
        points = "every point" if step == 1 else f"one of {step} points"
        for name, variable in dataset.variables.items():
            is_curve = variable.dims[-1:] == (dim,) and (variable.ndim == 1 or name == shown)
            if not is_curve or variable.dtype.kind not in "fiub":
                continue
            flat = np.reshape(variable.values.astype(float), (-1, variable.shape[-1]))[:, ::step]
            unit = str(variable.attrs.get("units", "1"))
            for i, values in enumerate(flat):
                title = str(name) if len(flat) == 1 else f"{name} {i + 1}"
                found.setdefault(dim, []).append((experiment, title, unit, points, values))
        found.get(dim, []).sort(key=lambda curve: curve[1] != dim)
    return found
