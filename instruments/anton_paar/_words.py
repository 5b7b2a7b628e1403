"""The words of Anton Paar exports in four languages, and the repair of damaged letters.

Words are compared folded: without accents, case and punctuation. Where a file's structure tells
what a line is (a label and two whole numbers begin an interval), its words are not asked at all.
"""

import re
import unicodedata

from instruments._symbols import named
from labpipe.errors import InputError
from labpipe.units import Unit, unit

_NOT_WORD = re.compile(r"[^0-9a-z]+")

#: What a label before a table means, by its folded spellings.
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

#: What a column holds: the SI units that it may become (none of text), and its folded spellings.
_COLUMNS = {
    "point": (
        "",
        "point no, meas pts, measuring point, punkt nr, messpunkt, messpkt, messpkte, mess pkt, point n, no du point, "
        "n du point, pts mes, no do ponto, ponto no, n o de punto, no de punto, punto n o, n punto, punto n",
    ),
    "time": ("s", "time, zeit, temps, tempo, test time, versuchszeit"),
    "interval_time": (
        "s",
        "interval time, intervallzeit, abschnittszeit, temps d intervalle, temps de l intervalle, tempo do intervalo",
    ),
    "time_of_day": ("", "time of day, uhrzeit, tageszeit, heure, hora, hora do dia"),
    "angular_frequency": (
        "rad/s, Hz, 1/s",
        "angular frequency, kreisfrequenz, frequence angulaire, pulsation, frequencia angular",
    ),
    "frequency": ("Hz, rad/s", "frequency, frequenz, frequence, frequencia"),
    "temperature": (
        "degC",
        "temperature, temperatur, temperatura, measured temperature, sample temperature, actual temperature",
    ),
    "temperature_set": (
        "degC",
        "set temperature, temperature set, temperature set value, solltemperatur, temperature de consigne, "
        "temperatura definida",
    ),
    "storage_modulus": (
        "Pa",
        "storage modulus, speichermodul, module de stockage, module de conservation, modulo de armazenamento, "
        "extensional storage modulus, storage modulus e, storage modulus g",
    ),
    "loss_modulus": (
        "Pa",
        "loss modulus, verlustmodul, module de perte, modulo de perda, extensional loss modulus, loss modulus e, "
        "loss modulus g",
    ),
    "loss_factor": (
        "1",
        "loss factor, verlustfaktor, damping factor, facteur de perte, facteur d amortissement, fator de perda, "
        "tan delta",
    ),
    "complex_modulus": ("Pa", "complex modulus, komplexer modul, module complexe, modulo complexo"),
    "complex_viscosity": ("Pa s", "complex viscosity, komplexe viskositat, viscosite complexe, viscosidade complexa"),
    "complex_viscosity_real": ("Pa s", "re complex viscosity, real part complex viscosity"),
    "complex_viscosity_imaginary": ("Pa s", "im complex viscosity, imaginary part complex viscosity"),
    "strain": (
        "1",
        "shear strain, strain, deformation, scherdeformation, scherung, extensional strain, dehnung, "
        "deformation de cisaillement, deformacao de cisalhamento, deformacao, deformation en extension",
    ),
    "stress": (
        "Pa",
        "shear stress, stress, schubspannung, spannung, zugspannung, extensional stress, contrainte de cisaillement, "
        "contrainte, tensao de cisalhamento, tensao",
    ),
    "shear_rate": (
        "1/s",
        "shear rate, scherrate, schergeschwindigkeit, taux de cisaillement, vitesse de cisaillement, "
        "taxa de cisalhamento",
    ),
    "viscosity": ("Pa s", "viscosity, viskositat, viscosite, viscosidade"),
    "relaxation_modulus": ("Pa", "relaxation modulus, relaxationsmodul, module de relaxation, modulo de relaxacao"),
    "creep_compliance": (
        "1/Pa",
        "creep compliance, kriechnachgiebigkeit, complaisance, complaisance en fluage, compliancia de fluencia",
    ),
    "torque": ("N m", "torque, drehmoment, moment, couple, torque do motor"),
    "normal_force": ("N", "normal force, normalkraft, force normale, forca normal"),
    "deflection_angle": (
        "rad",
        "deflection angle, auslenkwinkel, angle de deflexion, angle de deviation, angulo de deflexao",
    ),
    "phase_angle": ("rad", "phase shift angle, phase angle, phasenverschiebungswinkel, angle de phase, angulo de fase"),
    "gap": ("m", "gap, spalt, measuring gap, messspalt, entrefer, abertura"),
    "status": ("", "status, etat, estado, statut"),
}

#: Columns that hold text.
TEXT_COLUMNS = ("status", "time_of_day")

#: SI unit that a known column must become; another is a mistake in the file, not a conversion.
SI_OF = {name: tuple(units.split(", ")) for name, (units, _) in _COLUMNS.items() if units}

_LABEL_OF = {word: name for name, words in _LABELS.items() for word in words.split(", ")}
_COLUMN_OF = {word: name for name, (_, words) in _COLUMNS.items() for word in words.split(", ")}
_INVALID = ("invalid", "invalide", "ungultig", "invalido")
_COUNT = re.compile(r"\s*(\d{1,9})\s*(?:\(\s*(.+?)\s*\))?\s*")


def fold(text: str) -> str:
    """Return letters and digits only, without accents and case.

    Examples
    --------
    >>> fold("Résultat:"), fold("Point No.")
    ('resultat', 'point no')
    """
    plain = unicodedata.normalize("NFKD", text.casefold())
    plain = "".join(c for c in plain if not unicodedata.combining(c))
    return _NOT_WORD.sub(" ", plain).strip()


def label(text: str) -> str | None:
    """Return what a label means, or None when it is not known."""
    return _LABEL_OF.get(fold(text))


def column_name(text: str) -> str | None:
    """Return the canonical name of a column, or None when it is not known.

    Examples
    --------
    >>> column_name("Speichermodul"), column_name("储能模量"), column_name("Torque 2")
    ('storage_modulus', 'storage_modulus', None)
    """
    found = _COLUMN_OF.get(fold(text)) or named(text)
    return found if found in SI_OF or found in TEXT_COLUMNS or found == "point" else None


def slug(text: str) -> str:
    """Make a variable name of an unknown column."""
    return _NOT_WORD.sub("_", fold(text)).strip("_") or "column"


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


def repaired(text: str) -> str:
    """Undo UTF-8 that was read as cp1252 (``Âµ``, ``Ã©``, ``â„¢``); other text is unchanged."""
    if not any(sign in text for sign in "ÂÃâ"):
        return text
    try:
        return text.encode("cp1252").decode("utf-8")
    except UnicodeError:
        return text


TEMPERATURES = tuple(name for name, units in SI_OF.items() if "degC" in units)
"""Columns that are kept in degC, also where a file gives K."""

_LOST = "\N{REPLACEMENT CHARACTER}"


def unit_of(text: str) -> Unit:
    """Look the unit of a column up; ``µ``, ``·`` and ``°`` may have been lost.

    Raises
    ------
    InputError
        It is not known.

    Examples
    --------
    >>> unit_of("[mN·m]").si, unit_of("[°C]").si
    ('N m', 'degC')
    """
    name = repaired(text.strip()).strip("[]() ")
    if name == "K":
        return Unit(1.0, "K")
    if _LOST in name:
        # Only three letters outside ASCII stand in these units, each in a place of its own.
        name = "°" + name[1:] if name == f"{_LOST}C" else name
        name = "µ" + name[1:] if name.startswith(_LOST) else name
        name = name.replace(_LOST, "·")
    found = unit(name)
    if not name:
        raise InputError(f'unknown unit "{text}"')
    return found
