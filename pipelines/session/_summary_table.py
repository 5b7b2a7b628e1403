"""One table of a session for a thesis: a row for each quantity, beside what it is compared with.

The same rows become a sheet of a workbook, a table of LaTeX and one of csv. A workbook has one more
sheet for each family of curves: what experiments of one kind have in common.
"""

from __future__ import annotations

import io
import math
import re
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import xarray as xr

from labpipe.report import display_unit, number, plus_minus
from labpipe.workflow.plan import READY
from labpipe.workflow.results import Results
from labpipe.workflow.session import Experiment
from pipelines.experiments import KINDS
from pipelines.experiments.shared.comparison_rows import Row, row
from pipelines.session._comparison import compared, labelled
from pipelines.session._export_formats import one_line, text_cell
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
"""Points that make a curve; shorter variables stand in the table or in ``export --format csv``."""
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Time of every part of a workbook, so that equal work gives equal bytes."""
_LATEX = {
    **{c: f"\\{c}" for c in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "±": r"$\pm$",
    "×": r"$\times$",
    "−": "$-$",
    "°": r"$^\circ$",
    "µ": r"$\mu$",
    "·": r"$\cdot$",
    "δ": r"$\delta$",
    "′": "$'$",
    "″": "$''$",
    "\N{NO-BREAK SPACE}": "~",
    "\N{EN DASH}": "--",
    "\N{EM DASH}": "---",
}
_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")


class _Column(NamedTuple):
    """A curve on a sheet: what stands above it, and its values."""

    experiment: str
    title: str
    unit: str
    points: str
    values: Any


@dataclass(frozen=True, slots=True)
class Line:
    """One quantity of one experiment.

    ``row`` is what was measured and what it is compared with; of a key number that is compared with nothing
    ``against`` is empty. ``believable`` and ``model`` are the verdict on its experiment, "" where there is none.
    """

    row: Row
    believable: str
    model: str

    @property
    def cells(self) -> tuple[Any, ...]:
        """Values in the order of :data:`COLUMNS`; None for what there is not."""
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
        known = {r.measured for r in rows}  # a key number may be what is compared
        rows += [labelled(r, experiment, session) for r in _key_numbers(results, experiment) if r.measured not in known]
        found += [Line(r, *verdict) for r in rows]
    return found


def _key_numbers(results: Results, experiment: Experiment) -> Iterator[Row]:
    for key in KINDS[experiment.kind].key_numbers:
        dataset = _dataset(results, experiment.name, key.stage)
        if dataset is not None and (found := key.within(dataset)) is not None:
            value, u = found
            yield row(key.title, key.unit, 1, against="", measured=value, u_measured=math.nan if u is None else u)


def _dataset(results: Results, experiment: str, stage: str) -> xr.Dataset | None:
    wanted = (row for row in results.plan.rows if (row.experiment, row.stage) == (experiment, stage))
    found = next((row for row in wanted if row.recording is None and row.state in READY), None)
    return None if found is None else results.up_to_date(found)


# --- LaTeX ---


def tex_text(found: Sequence[Line], remarks: Mapping[str, str]) -> str:
    r"""Write the table for LaTeX; it wants ``\usepackage{booktabs}`` and nothing else.

    Each number is rounded to two digits of its uncertainty and has the prefix that its size asks
    for. Curves give their nRMSE.
    """
    head = ("experiment", "quantity", "unit", "measured", "expected", "deviation", "verdict")
    body = []
    for line in found:
        r = line.row
        unit, factor = _scaled(r) if r.nrmse is None else ("", 1.0)
        deviation = "" if r.deviation is None else f"{number(r.deviation, 2)} u"
        deviation = f"nRMSE {number(100 * r.nrmse, 2)} %" if r.nrmse is not None else deviation
        verdict = ", model ".join(part for part in (line.believable, line.model) if part and part != "none")
        values = (_shown(r.measured, r.u_measured, factor), _shown(r.model, r.u_model, factor))
        quantity = ", ".join(part for part in (r.quantity, r.condition) if part)
        body.append((r.experiment, quantity, unit, *values, deviation, verdict))
    above = "".join(f"% {key}: {one_line(value)}\n" for key, value in remarks.items())
    rows = "".join(" & ".join(map(_latex, cells)) + r" \\" + "\n" for cells in body)
    titles = " & ".join(map(_latex, head)) + r" \\"
    return (
        f"{above}\\begin{{tabular}}{{lllllll}}\n\\toprule\n{titles}\n\\midrule\n{rows}\\bottomrule\n\\end{{tabular}}\n"
    )


def _scaled(r: Row) -> tuple[str, float]:
    """Return a unit that suits a row's values, and what they are divided by."""
    shown = display_unit([v for v in (r.measured, r.model, r.difference) if v is not None], r.unit)
    return shown.text, shown.factor


def _shown(value: float | None, u: float | None, factor: float) -> str:
    if value is None:
        return ""
    return number(value / factor, 4) if not u else plus_minus(value / factor, u / factor)


def _latex(text: str) -> str:
    powers = re.sub(r"[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+", lambda m: f"\0{m[0].translate(_SUPERSCRIPTS)}\1", one_line(text))
    plain = "".join(_LATEX.get(character, character) for character in powers)
    return plain.replace("\0", "$^{").replace("\1", "}$")


# --- csv ---


def csv_text(found: Sequence[Line], remarks: Mapping[str, str]) -> str:
    """Write the table as csv, values exact and in SI."""
    head = "".join(f"# {key}: {one_line(value)}\n" for key, value in remarks.items())
    rows = [",".join(map(_csv_cell, cells)) for cells in (COLUMNS, *(line.cells for line in found))]
    return head + "\n".join(rows) + "\n"


def _csv_cell(value: Any) -> str:
    if value is None:
        return ""
    return text_cell(value) if isinstance(value, str) else repr(value)


# --- workbook ---


def xlsx_bytes(results: Results, found: Sequence[Line], remarks: Mapping[str, str]) -> bytes:
    """Write a workbook: the table, a sheet for each family of curves, and what it says of itself.

    Of curves with more than 2,000 points every second, third ... is taken, as their heads say; whole
    ones are in the csv files. Equal results give equal bytes.
    """
    from openpyxl import Workbook

    book = Workbook(write_only=True)
    sheet = book.create_sheet("quantities")
    sheet.freeze_panes = "B2"
    _append(sheet, COLUMNS)
    for line in found:
        _append(sheet, line.cells)
    for title, columns in _families(results, list(dict.fromkeys(line.row.experiment for line in found))):
        sheet = book.create_sheet(title)
        sheet.freeze_panes = "A5"
        for head in list(zip(*columns, strict=True))[:4]:
            _append(sheet, head)
        for cells in _across([values for *_, values in columns]):
            sheet.append(cells)
    about = book.create_sheet("about")
    for item in remarks.items():
        _append(about, item)
    stream = io.BytesIO()
    book.save(stream)
    return _timeless(stream.getvalue())


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


def _across(columns: Sequence[Any]) -> Iterator[list[float | None]]:
    """Lay columns of different length side by side."""
    plain = [[v if math.isfinite(v) else None for v in column.tolist()] for column in columns]
    for i in range(max(map(len, plain))):
        yield [column[i] if i < len(column) else None for column in plain]


def _families(results: Results, names: Sequence[str]) -> Iterator[tuple[str, list[_Column]]]:
    """Yield the sheets of curves: title, and the columns."""
    kinds: dict[str, list[str]] = {}
    for name in names:
        kinds.setdefault(results.experiments[name].kind, []).append(name)
    for kind_name, members in kinds.items():
        kind = KINDS[kind_name]
        drawn = kind.picture
        stages = dict.fromkeys((drawn.stage if drawn else "", "model", "comparison"))
        for stage in (s.name for s in kind.stages if s.name in stages):
            sheets: dict[str, list[_Column]] = {}
            for name in members:
                dataset = _dataset(results, name, stage)
                if dataset is not None:
                    shown = drawn.y if drawn is not None and stage == drawn.stage else ""
                    for dim, columns in _curves(name, dataset, shown).items():
                        sheets.setdefault(dim, []).extend(columns)
            for dim, columns in sheets.items():
                yield f"{kind_name} {stage} {dim}"[:_SHEET_NAME], columns


def _curves(experiment: str, dataset: xr.Dataset, shown: str) -> dict[str, list[_Column]]:
    """Return the columns of a result by the dimension along which they run.

    Variables of one dimension are curves; of more only the one that the overview draws, a column
    for each.
    """
    import numpy as np

    found: dict[str, list[_Column]] = {}
    for dim in map(str, dataset.dims):
        if dataset.sizes[dim] < _LEAST_CURVE:
            continue
        step = math.ceil(dataset.sizes[dim] / _MOST_POINTS)
        points = "every point" if step == 1 else f"one of {step} points"
        for name, variable in dataset.variables.items():
            if (
                variable.dims[-1:] != (dim,)
                or variable.dtype.kind not in "fiub"
                or (variable.ndim > 1 and name != shown)
            ):
                continue
            flat = np.reshape(variable.values.astype(float), (-1, variable.shape[-1]))[:, ::step]
            unit = str(variable.attrs.get("units", "1"))
            for i, values in enumerate(flat):
                title = str(name) if len(flat) == 1 else f"{name} {i + 1}"
                found.setdefault(dim, []).append(_Column(experiment, title, unit, points, values))
        found.get(dim, []).sort(key=lambda column: column.title != dim)  # the axis first
    return found


def _timeless(book: bytes) -> bytes:
    """Write a workbook again without the time of day."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(book)) as old, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "docProps/core.xml":
                data = re.sub(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", b"1980-01-01T00:00:00Z", data)
            new.writestr(zipfile.ZipInfo(name, _EPOCH), data, zipfile.ZIP_DEFLATED)
    return out.getvalue()
