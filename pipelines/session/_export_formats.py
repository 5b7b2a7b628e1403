"""Datasets as netCDF of the CF conventions, as tables of text, JSON and MATLAB files; one table of all quantities.

Every format keeps units, long names and the provenance, and none a time of day: two exports of one
result are equal byte for byte.
"""

import io
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

import msgspec
import numpy as np
import pandas as pd
import xarray as xr

from labpipe.installation import __version__
from labpipe.report import number
from labpipe.workflow.results import Results
from pipelines.experiments.shared.comparison_rows import Row, row
from pipelines.session._comparison import compared, labelled, sides
from pipelines.session._results import key_numbers, opened
from pipelines.session._verdicts import stored_verdicts

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""A spreadsheet takes a cell that begins with one of these for a formula."""
_HIDDEN = re.compile(r"([;,]\s*)(?=[=+@]|-[^\d.])")
"""Where a cell would begin for a spreadsheet that splits at semicolons, whatever the quotes, or
that splits a remark; a negative number is none."""
_CONTROL = re.compile(r"[\x00-\x1f\x7f\x85\u2028\u2029]+")
_APART = r"\1'"
CONVENTIONS = "CF-1.11"
"""The climate and forecast conventions, https://cfconventions.org, which programs that read netCDF know."""
_MATLAB_HEAD = 116  # bytes of free text


def cf_dataset(dataset: xr.Dataset, remarks: Mapping[str, str]) -> xr.Dataset:
    """Return a Dataset as the CF conventions describe one: units of UDUNITS, a long name of every variable, flags.

    UDUNITS has no pixel: a variable in px is a number whose remark says so, m/px becomes m.
    """
    ours = f"labpipe {__version__}"
    known = {"source": ours, "history": f"processed by {ours}", **dataset.attrs, **remarks}
    made = dataset.assign_attrs(known | {"Conventions": CONVENTIONS})
    for name, variable in made.variables.items():
        attrs = {"long_name": str(name).replace("_", " ")} | variable.attrs
        if "px" in (unit := str(attrs.get("units", ""))):
            attrs |= {"units": "m" if unit == "m/px" else "1", "comment": f"unit: {unit}"}
        if variable.dtype.kind == "b":
            attrs |= {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "false true"}
        elif variable.dtype.kind in "iuf":
            attrs.setdefault("units", "1")
        if isinstance(flags := attrs.get("flag_values"), np.ndarray) and variable.dtype.kind in "iu":
            attrs["flag_values"] = flags.astype(variable.dtype)
        variable.attrs = attrs
    return made


def csv_tables(dataset: xr.Dataset, remarks: Mapping[str, str], decimal: str = ".") -> dict[str, str]:
    """Write a Dataset as tables, one for all variables of equal dimensions, by those: ``"time"``, ``"repeat-time"``.

    A table over several dimensions has one row per combination, with one column per dimension; variables without
    dimensions are in ``"values"``. Remarks are above the table, one line each, after ``#``; below the head of names
    is a row of units.

    Examples
    --------
    >>> made = csv_tables(xr.Dataset({"x": ("time", [1.0, 2.5], {"units": "m"})}), {})
    >>> print(made["time"], end="")
    time,x
    1,m
    0,1.0
    1,2.5
    """
    groups: dict[tuple[str, ...], list[str]] = {}
    for name, variable in dataset.variables.items():
        if variable.dims != (name,):
            groups.setdefault(tuple(map(str, variable.dims)), []).append(str(name))
    for name in map(str, dataset.dims):  # a coordinate over which there is nothing else
        if name in dataset.variables and not any(name in dims for dims in groups):
            groups[name,] = []
    made, plain = {}, dataset.reset_coords()
    for dims, names in groups.items():
        table = pd.DataFrame({name: plain[name].values.ravel() for name in names})
        if dims:
            held = plain[[*names, *(dim for dim in dims if dim in plain.variables)]]
            table = held.to_dataframe(dim_order=list(dims)).reset_index()
        units = [dataset[n].attrs.get("units", "1" if n in dims else "") if n in dataset else "1" for n in table]
        made["-".join(dims) or "values"] = csv_text(table, remarks, units, decimal)
    return made


def csv_text(table: pd.DataFrame, remarks: Mapping[str, str], units: Iterable[str] = (), decimal: str = ".") -> str:
    """Write a table as csv below remarks; no text is one that a spreadsheet takes for a formula.

    With a decimal comma, semicolons separate the columns.

    Examples
    --------
    >>> print(csv_text(pd.DataFrame({"x": [0.5, 2.0]}), {}, ["m"], ","), end="")
    x
    m
    0,5
    2,0
    """
    frame = table.copy()
    for name, column in table.items():
        if column.dtype.kind == "b":
            frame[name] = column.astype(int)
        elif column.dtype.kind not in "fiu":
            frame[name] = column.map(lambda value: safe_text(value) if isinstance(value, str) else value)
    top = pd.DataFrame([list(map(safe_text, row)) for row in (map(str, table.columns), units) if row])
    head = "".join(f"# {key}: {_HIDDEN.sub(_APART, one_line(value))}\n" for key, value in remarks.items())
    absent = "nan" if units else ""
    style: dict[str, Any] = {"index": False, "header": False, "sep": ";" if decimal == "," else ","}
    parts = (top.to_csv(**style), frame.to_csv(**style, na_rep=absent, decimal=decimal))
    return head + "".join(parts).replace("\r\n", "\n")


def safe_text(text: str) -> str:
    """Write a text on one line that no spreadsheet takes for a formula, wherever it splits.

    Examples
    --------
    >>> safe_text("=1+1"), safe_text("a;=1+1")
    ("'=1+1", "a;'=1+1")
    """
    text = _HIDDEN.sub(_APART, one_line(text))
    return f"'{text}" if text.startswith(_FORMULA) else text


def one_line(text: str) -> str:
    """Replace line ends and control characters by blanks."""
    return _CONTROL.sub(" ", text)


def json_text(dataset: xr.Dataset, remarks: Mapping[str, str]) -> str:
    """Write a Dataset as JSON: ``remarks``, ``dimensions``, ``attributes``, ``variables``; NaN becomes null."""
    made = dataset.to_dict()
    variables = {
        name: {"dimensions": one["dims"], **one["attrs"], "values": one["data"]}
        for name, one in (made["coords"] | made["data_vars"]).items()
    }
    document = {"remarks": remarks, "dimensions": made["dims"], "attributes": made["attrs"], "variables": variables}
    return msgspec.json.format(msgspec.json.encode(document, enc_hook=str), indent=1).decode() + "\n"


def mat_bytes(dataset: xr.Dataset, remarks: Mapping[str, str]) -> bytes:
    """Write a Dataset as a MATLAB file (version 5), with structures of units, long names, dimensions and remarks."""
    from scipy.io import savemat

    texts = {str(n): v for n, v in dataset.variables.items()}
    content: dict[str, Any] = {
        n: v.values.astype(object) if v.dtype.kind in "OU" else v.values for n, v in texts.items()
    }
    content |= {key: {n: str(v.attrs.get(key, "")) for n, v in texts.items()} for key in ("units", "long_name")}
    content |= {"dimensions": {n: ", ".join(map(str, v.dims)) for n, v in texts.items()}, "remarks": dict(remarks)}
    stream = io.BytesIO()
    savemat(stream, content, long_field_names=True, oned_as="column", do_compression=True)
    # by default the time of day is in the free text that begins the file
    head = b"MATLAB 5.0 MAT-file, written by labpipe".ljust(_MATLAB_HEAD)
    return head + stream.getvalue()[_MATLAB_HEAD:]


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
    wanted, found = set(experiments) or set(results.experiments), list[Row]()
    for name in (name for name in results.experiments if name in wanted):
        own = compared(results, name) or []
        known = {r.measured for r in own}  # a key number may be one of those that are compared
        found += own
        for title, (value, u, unit) in key_numbers(results, name).items():
            if value not in known:
                one = row(title, unit, 1, against="", measured=(value, math.nan if u is None else u))
                found.append(labelled(one, results.experiments[name], results.plan.session))
    return found


def frame(results: Results, rows: Iterable[Row]) -> pd.DataFrame:
    """Return one line for each quantity, in SI, with the verdict on its experiment; texts are on one line."""
    verdicts = stored_verdicts(opened(results.plan.session.root))
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
        measured, expected, _, unit = sides(r)
        deviation = "" if r.deviation is None else f"{number(r.deviation, 2)} u"
        if r.nrmse is not None:
            unit, deviation = "", f"nRMSE {number(100 * r.nrmse, 2)} %"
        verdict = ", model ".join(part for part in (believable, model) if part and part != "none")
        quantity = ", ".join(part for part in (r.quantity, r.condition) if part)
        body.append((r.experiment, quantity, unit, measured, expected, deviation, verdict))
    head = ("experiment", "quantity", "unit", "measured", "expected", "deviation", "verdict")
    above = "".join(f"% {key}: {one_line(value)}\n" for key, value in remarks.items())
    cells = pd.DataFrame(body, columns=head).map(lambda cell: one_line(cell).translate(_LATEX))
    return above + cells.to_latex(index=False, escape=False)


def xlsx_bytes(table: pd.DataFrame, remarks: Mapping[str, str]) -> bytes:
    """Write a workbook: the table, and a sheet about itself; texts stay texts, those that begin like a formula too."""
    stream = io.BytesIO()
    with pd.ExcelWriter(stream, engine="openpyxl") as book:
        table.to_excel(book, sheet_name="quantities", index=False, freeze_panes=(1, 1))
        pd.DataFrame(remarks.items()).map(one_line).to_excel(book, sheet_name="about", index=False, header=False)
        for cell in (cell for sheet in book.sheets.values() for row in sheet.iter_rows() for cell in row):
            cell.data_type = "s" if cell.data_type == "f" else cell.data_type
    return stream.getvalue()
