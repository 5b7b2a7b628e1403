"""RheoCompass exports as the software writes them: UTF-16, TAB, CRLF."""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from instruments._quantities import unit_of
from instruments.anton_paar._dataset import intervals_of
from instruments.anton_paar._values import Column, Interval
from labpipe import files
from labpipe.errors import InputError
from labpipe.units import ZERO_CELSIUS

#: Labels in front of project, test, result, the two numbers of an interval, and its columns.
LANGUAGES: dict[str, tuple[str, str, str, str, str]] = {
    "en": ("Project:", "Test:", "Result:", "Interval and data points:", "Interval data:"),
    "de": ("Projekt:", "Versuch:", "Ergebnis:", "Abschnitt und Datenpunkte:", "Abschnittsdaten:"),
    "fr": ("Projet:", "Test:", "Résultat:", "Intervalle et points de données:", "Intervalle données:"),
    "pt": ("Projeto:", "Teste:", "Resultado:", "Intervalo e ponto de dados:", "Dados do intervalo:"),
}
_POINT = {"en": "Point No.", "de": "Punkt-Nr.", "fr": "Point No.", "pt": "No. do Ponto"}
_INVALID = {"en": "(invalid)", "de": "(ungültig)", "fr": "(invalide)", "pt": "(inválido)"}


@dataclass(frozen=True, slots=True)
class _Style:
    delimiter: str
    decimal: str
    language: str
    digits: int | None


def encode(
    dataset: xr.Dataset,
    *,
    encoding: str = "utf-16",
    delimiter: str = "\t",
    decimal: str = ".",
    language: str = "en",
    digits: int | None = None,
) -> bytes:
    """Turn a Dataset of the form of :func:`instruments.anton_paar.read` into an export.

    Parameters
    ----------
    dataset : Dataset
        As read or assembled.
    encoding : str
        ``"utf-16"`` is what RheoCompass writes (little-endian, with its mark).
    delimiter, decimal : str
        TAB and dot by default; decimal commas go with TAB or semicolon.
    language : {"en", "de", "fr", "pt"}
        Of the labels; headings of columns are kept.
    digits : int, optional
        Significant digits; by default as many as the number has.

    Raises
    ------
    InputError
        The delimiter is the decimal sign, the language is unknown, or a text holds the delimiter.
    """
    if delimiter == decimal:
        raise InputError(f'"{delimiter}" cannot be both delimiter and decimal sign')
    if language not in LANGUAGES:
        raise InputError(f'language "{language}" is unknown; expected one of {", ".join(LANGUAGES)}')
    style = _Style(delimiter, decimal, language, digits)
    labels = LANGUAGES[language]
    lines = [_joined([labels[0], str(dataset.attrs.get("project", ""))], style), ""]
    numbers = [(e["test"], e["result"]) for e in json.loads(dataset.attrs["tests"])]
    for index, interval in enumerate(intervals_of(dataset)):
        if index == 0 or numbers[index][0] != numbers[index - 1][0]:
            lines += [_joined([labels[1], interval.test], style), ""]
        if index == 0 or numbers[index] != numbers[index - 1]:
            lines += [_joined([labels[2], interval.result], style), ""]
        lines += [*_table(interval, style), ""]
    text = "\r\n".join(lines[:-1]) + "\r\n"
    return b"\xff\xfe" + text.encode("utf-16-le") if encoding == "utf-16" else text.encode(encoding)


def _joined(cells: Sequence[str], style: _Style) -> str:
    return style.delimiter.join(_quoted(c, style) for c in cells)


def _quoted(cell: str, style: _Style) -> str:
    if "\n" in cell or "\r" in cell or (style.delimiter == "\t" and "\t" in cell):
        raise InputError(f"a cell of an export holds no line end and no TAB: {cell!r}")
    needs = style.delimiter != "\t" and (style.delimiter in cell or '"' in cell)
    return '"' + cell.replace('"', '""') + '"' if needs else cell


def _table(interval: Interval, style: _Style) -> list[str]:
    labels = LANGUAGES[style.language]
    columns = interval.columns
    count = interval.point.size
    declared = count if interval.declared is None else interval.declared
    point = _POINT[style.language]
    rows = [
        [labels[3], str(interval.number), str(declared)],
        [labels[4], point, *(c.header for c in columns)],
        ["", "", *(c.sub_label for c in columns)],
        ["", "", *(c.unit for c in columns)],
    ]
    written = [_written(c, style) for c in columns]
    for i in range(count):
        number = str(interval.point[i]) if interval.point[i] else ""
        if not interval.is_valid[i]:
            number = f"{number} {_INVALID[style.language]}"
        rows.append(["", number, *(w[i] for w in written)])
    return [_joined(row, style) for row in rows]


def _written(column: Column, style: _Style) -> list[str]:
    if isinstance(column.values, list):
        return column.values
    zero = 0.0
    try:
        factor, si = unit_of(column.unit) if column.unit else (1.0, "")
        zero = ZERO_CELSIUS if (si, column.si) == ("K", "degC") else 0.0
    except InputError:
        factor = 1.0  # an unknown quantity was kept in its own unit
    cells = []
    for value in (column.values / factor + zero).tolist():
        if np.isnan(value):
            cells.append("")
            continue
        text = repr(value) if style.digits is None else f"{value:.{style.digits}g}"
        cells.append(text.replace("e", "E").replace(".", style.decimal))
    return cells


def write(path: str | os.PathLike[str], dataset: xr.Dataset, *, digits: int | None = None) -> None:
    """Write an export as the software does; see :func:`encode`.

    Raises
    ------
    InputError
        As :func:`encode`.
    StorageError
        The file cannot be written.
    """
    files.write_bytes(path, encode(dataset, digits=digits))
