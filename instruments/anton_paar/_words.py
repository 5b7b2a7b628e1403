"""The labels of Anton Paar exports in four languages.

Where a file's structure shows the meaning of a line (a label and two whole numbers begin an interval), its words are
not needed.
"""

import re

from instruments._quantities import fold

#: The meaning of a label before a table, by its spellings.
_LABELS = {
    "project": "project, projekt, projet, projeto, file, data series information, datenreihen information",
    "test": "test, teste, essai, versuch, name",
    "result": "result, ergebnis, resultat, resultado",
    "interval": "interval, abschnitt, messabschnitt, intervalle, intervalo",
    "points": (
        "number of data points, anzahl datenpunkte, anzahl messpunkte, nombre de points de donnees, "
        "numero de pontos de dados"
    ),
    "header": (
        "interval data, intervalldaten, abschnittsdaten, intervall daten, intervalle donnees, interval donnees, "
        "donnees intervalle, dados do intervalo, intervalo dados"
    ),
}
_LABEL_OF = {fold(word): name for name, words in _LABELS.items() for word in words.split(", ")}
_INVALID = ("invalid", "invalide", "ungultig", "invalido")
_COUNT = re.compile(r"\s*(\d{1,9})(?:\.0*)?\s*(?:\(\s*(.+?)\s*\))?\s*")


def label(text: str) -> str | None:
    """Return the meaning of a label, or None when it is not known."""
    return _LABEL_OF.get(fold(text))


def point_number(text: str) -> tuple[int, bool] | None:
    """Read a point number and whether the point is valid; None when it is neither.

    Examples
    --------
    >>> point_number("7"), point_number("8 (invalid)"), point_number("8 (perhaps)")
    ((7, True), (8, False), None)
    """
    match = _COUNT.fullmatch(text)
    if match is None or (match[2] is not None and fold(match[2]) not in _INVALID):
        return None
    return int(match[1]), match[2] is None
