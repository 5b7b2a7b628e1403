"""Quantities that instruments tabulate: canonical names, SI units, and how exports spell them.

A spelling is compared folded (:func:`fold`): primes the same, without accents, blanks and punctuation, a lone
letter with its case, which separates temperature ``T`` from time ``t``. The words are those of RheoCompass and
RheoPlus, TRIOS and Universal Analysis, Proteus, RheoWin and RepTate in English, German, French, Spanish,
Italian, Portuguese, Japanese and Chinese, and the usual symbols.
"""

import re
import unicodedata
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from labpipe.errors import InputError, SourceError
from labpipe.text import DOT, Separators, separators
from labpipe.units import Unit, plain, unit

_MODULUS = "Pa"
_COMPLIANCE = "1/Pa"
_VISCOSITY = "Pa s"
_DEGREES = "degC, K, degF"

#: Canonical name to the SI units that it may become ("" of text), and its spellings.
_TABLE = {
    "displacement": ("m, V", ""),  # those of traces are named by the user, never recognised
    "position": ("m", ""),
    "force": ("N", ""),
    "point": (
        "",
        "point no, meas pts, measuring point, punkt nr, messpunkt, messpunkte, messpkt, messpkte, mess pkt, "
        "point n, no du point, n du point, pts mes, no do ponto, ponto no, n o de punto, no de punto, punto n o, "
        "n punto, punto n, point",
    ),
    "status": ("", "status, etat, estado, statut"),
    "time_of_day": ("", "time of day, uhrzeit, tageszeit, heure, hora, hora do dia"),
    "time": (
        "s",
        "t, time, test time, elapsed time, time elapsed, total time, run time, zeit, versuchszeit, temps, tempo, 時間",
    ),
    "interval_time": (
        "s",
        "interval time, step time, segment time, action time, t_seg, intervallzeit, abschnittszeit, "
        "temps d intervalle, temps de l intervalle, tempo do intervalo",
    ),
    "frequency": (
        "Hz, rad/s",
        "f, freq, freqs, frequency, frequencies, ν, frequenz, frequence, frequencia, frecuencia, frequenza, 周波数, "
        "频率",
    ),
    "angular_frequency": (
        "rad/s, Hz, 1/s",
        "w, ω, omega, omegas, ang freq, angular freq, angular frequency, circular frequency, kreisfrequenz, "
        "frequence angulaire, pulsation, frequencia angular, frecuencia angular, pulsazione, 角周波数, 角频率",
    ),
    "temperature": (
        _DEGREES,
        "T, Ts, temp, temperature, temperatures, temperatur, temperatura, temp1, tmeas, measured temperature, "
        "meas temp, sample temp, sample temperature, specimen temperature, actual temperature, t probe, "
        "probentemperatur, isttemperatur, 温度, 試料温度",
    ),
    "temperature_set": (
        _DEGREES,
        "Tr, tset, t set, set temp, set temperature, temperature set, temperature set value, setpoint, "
        "set point temperature, temperature setpoint, nominal temperature, program temperature, oven temperature, "
        "furnace temperature, chamber temperature, t soll, solltemperatur, temperature de consigne, "
        "temperatura definida, temperatura de consigna, temperatura impostata",
    ),
    "storage_modulus": (
        _MODULUS,
        "e', g', m', k', e' modul, e stor, g stor, e storage, g storage, e prime, g prime, ep, gp, e1, g1, storage, "
        "storage modulus, storage mod, stor mod, elastic modulus, shear storage modulus, tensile storage modulus, "
        "flexural storage modulus, bending storage modulus, extensional storage modulus, youngs storage modulus, "
        "shear modulus elastic component, speichermodul, module de stockage, module de conservation, "
        "modulo de armazenamento, modulo de almacenamiento, modulo conservativo, 貯蔵弾性率, 储能模量",
    ),
    "loss_modulus": (
        _MODULUS,
        "e'', g'', m'', k'', e'' modul, e loss, g loss, e double prime, g double prime, epp, gpp, e2, g2, loss, "
        "loss modulus, loss mod, viscous modulus, shear loss modulus, tensile loss modulus, flexural loss modulus, "
        "bending loss modulus, extensional loss modulus, youngs loss modulus, shear modulus viscous component, "
        "verlustmodul, module de perte, modulo de perda, modulo de perdida, modulo dissipativo, 損失弾性率, 损耗模量",
    ),
    "loss_factor": (
        "1",
        "tan delta, tan d, tanδ, tan del, tan, loss tangent, loss factor, damping, damping factor, tgδ, verlustfaktor, "
        "facteur de perte, facteur d amortissement, fator de perda, factor de perdida, fattore di perdita, 損失正接, "
        "损耗因子",
    ),
    "phase_angle": (
        "rad",
        "delta, δ, phase, phase angle, phase lag, phase shift, phase shift angle, loss angle, "
        "phasenverschiebungswinkel, angle de phase, angulo de fase, 位相差",
    ),
    "complex_modulus": (
        _MODULUS,
        "e*, g*, m*, e star, g star, complex modulus, dynamic modulus, complex shear modulus, komplexer modul, "
        "komplexer schubmodul, shear modulus complex component, module complexe, modulo complexo, 複素弾性率, 复数模量",
    ),
    "storage_compliance": (_COMPLIANCE, "d', j', j prime, d prime, storage compliance"),
    "loss_compliance": (_COMPLIANCE, "d'', j'', j double prime, d double prime, loss compliance"),
    "complex_compliance": (_COMPLIANCE, "d*, j*, complex compliance"),
    "complex_viscosity": (
        _VISCOSITY,
        "eta*, η*, eta star, complex viscosity, komplexe viskositat, viscosite complexe, viscosidade complexa",
    ),
    "complex_viscosity_real": (
        _VISCOSITY,
        "eta', η', dynamic viscosity, re complex viscosity, real part complex viscosity",
    ),
    "complex_viscosity_imaginary": (_VISCOSITY, "eta'', η'', im complex viscosity, imaginary part complex viscosity"),
    "relaxation_modulus": (
        _MODULUS,
        "e(t), g(t), e relax, g relax, relaxation modulus, stress relaxation modulus, relaxationsmodul, "
        "module de relaxation, modulo de relaxacao",
    ),
    "creep_compliance": (
        _COMPLIANCE,
        "j(t), d(t), creep compliance, compliance, j creep, d creep, kriechnachgiebigkeit, complaisance, "
        "complaisance en fluage, compliancia de fluencia",
    ),
    "strain": (
        "1",
        "strain, shear strain, extensional strain, deformation, scherdeformation, scherung, dehnung, "
        "deformation de cisaillement, deformacao de cisalhamento, deformacao, deformation en extension",
    ),
    "stress": (
        _MODULUS,
        "stress, shear stress, extensional stress, schubspannung, spannung, zugspannung, contrainte de cisaillement, "
        "contrainte, tensao de cisalhamento, tensao",
    ),
    "shear_rate": (
        "1/s",
        "shear rate, scherrate, schergeschwindigkeit, taux de cisaillement, vitesse de cisaillement, "
        "taxa de cisalhamento",
    ),
    "viscosity": (_VISCOSITY, "viscosity, viskositat, viscosite, viscosidade"),
    "torque": ("N m", "torque, drehmoment, moment, couple, torque do motor"),
    "normal_force": ("N", "normal force, normalkraft, force normale, forca normal"),
    "deflection_angle": (
        "rad",
        "deflection angle, auslenkwinkel, angle de deflexion, angle de deviation, angulo de deflexao",
    ),
    "gap": ("m", "gap, spalt, measuring gap, messspalt, entrefer, abertura"),
    "set": ("1", "set, sweep, isotherm, step, step no, segment, curve, run, cycle"),
    "log10_aT": ("1", "log at, log10 at, lg at, log a, log shift factor, log10 shift factor"),
    "ln_aT": ("1", "ln at, ln shift factor"),
    "a_T": ("1", "at, shift factor, horizontal shift factor"),
    "b_T": ("1", "bt, vertical shift factor"),
}

#: SI units that a quantity may become; another is a mistake in the file, not a conversion.
SI_OF = {name: tuple(units.split(", ")) for name, (units, _) in _TABLE.items() if units}
TEXT = ("status", "time_of_day")
TRACES = ("displacement", "position", "force")
TEMPERATURES = ("temperature", "temperature_set")
FREQUENCIES = frozenset({"frequency", "angular_frequency"})
TIMES = frozenset({"time", "interval_time"})
RESPONSES = frozenset({"relaxation_modulus", "creep_compliance"})
SHIFTS = frozenset({"log10_aT", "ln_aT", "a_T"})
MODULI = frozenset(name for name in SI_OF if name.partition("_")[0] in ("storage", "loss", "complex")) - {"loss_factor"}
#: Quantities of which no sweep, response or shift is made; a table is read without them.
OTHERS = frozenset({"stress", "strain", "shear_rate", "viscosity", "torque", "normal_force", "deflection_angle", "gap"})

_PRIMES = str.maketrans({"\u2032": "'", "\u2019": "'", "\u2018": "'", "\u00b4": "'", "`": "'", "\u02b9": "'"}) | {
    ord(sign): "''" for sign in "\u2033\u201d\u201c\"\u02ba"
}  # fmt: skip
_FOLDED_AWAY = re.compile(r"[\s_().,|:\[\]{}~^$\\\u2061-]+")
_NOT_WORD = re.compile(r"[^0-9a-z]+")
_CASED = ("T", "t", "Ts", "Tr")


@lru_cache(4096)
def fold(heading: str) -> str:
    """Reduce a heading to its spelling in the table.

    Examples
    --------
    >>> fold("log_aT"), fold("E″"), fold("T"), fold("t"), fold("Résultat:")
    ('logat', "e''", 'T', 't', 'resultat')
    """
    text = heading.strip().translate(_PRIMES).replace("\u2217", "*").replace("\u0394", "δ")
    text = re.sub(r"(?<=\w\w)'s\b", "s", text)  # Young's
    text = "".join(c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
    text = _FOLDED_AWAY.sub("", text)
    return text if text in _CASED else text.casefold()


_NAME_OF = {
    fold(spelling): name for name, (_, spellings) in _TABLE.items() for spelling in spellings.split(", ") if spelling
}


@lru_cache(4096)
def quantity(heading: str) -> str | None:
    """Return the canonical name of a quantity, None of another heading.

    A symbol may accompany its word: ``Storage modulus (G')``, ``E' storage modulus``.

    Examples
    --------
    >>> quantity("E_stor"), quantity("Speichermodul"), quantity("Storage Modulus G'"), quantity("colour")
    ('storage_modulus', 'storage_modulus', 'storage_modulus', None)
    """
    found = _NAME_OF.get(fold(heading))
    words = re.split(r"[\s,;:(\[-]+", heading.strip(" )]"))
    for k in range(1, len(words)):
        if found is not None:
            break
        first, second = (_NAME_OF.get(fold(" ".join(part))) for part in (words[:k], words[k:]))
        found = first if first == second else None
    return found


def slug(text: str) -> str:
    """Make a variable name of an unknown heading."""
    plain_text = "".join(c for c in unicodedata.normalize("NFKD", text.casefold()) if not unicodedata.combining(c))
    return _NOT_WORD.sub("_", plain_text.replace("\u03bc", "u")).strip("_") or "column"


def repaired(text: str) -> str:
    """Undo UTF-8 that was read as cp1252 (``Âµ``, ``Ã©``, ``â„¢``); other text is unchanged."""
    if not any(sign in text for sign in "ÂÃâ"):
        return text
    try:
        return text.encode("cp1252").decode("utf-8")
    except UnicodeError:
        return text


#: Spellings of units in exports beyond those of :mod:`labpipe.units`, folded to small letters.
_SPELLINGS = {
    spelling: Unit(factor, si)
    for factor, si, spellings in (
        (1.0, "rad/s", "rad/sec, rads-1, rad_s, rad_per_s, rad per s, radians/s"),
        (1.0, "degC", "deg c, degc, º c, ºc, oc, ° c, °c, celsius, cel, deg_c, c, ?c, ^circ c, circ c"),
        (1.0, "K", "k, kelvin"),
        (1.0, "degF", "°f, degf, deg f, fahrenheit, f"),
        (0.017453292519943295, "rad", "degree, degrees, deg, deg., º"),
        (1.0, "rad", "radian, radians"),
        (1e-2, "1", "percent, pct"),
        (1.0, "1", "none, dimensionless, /, --, #"),
        (1e6, "Pa", "n/mm2, mpa, mpascal"),  # a solid's modulus in millipascal does not exist
        (1.0, "Pa", "pa, n/m2"),
        (1e3, "Pa", "kpa, kn/m2"),
        (1e9, "Pa", "gpa, kn/mm2"),
        (0.1, "Pa", "dyn/cm2, dyne/cm2"),
        (6894.757293168361, "Pa", "psi"),
        (1.0, "1/Pa", "1/pa, m2/n"),
        (1e-3, "1/Pa", "1/kpa"),
        (1e-6, "1/Pa", "1/mpa"),
        (1e-9, "1/Pa", "1/gpa"),
        (1.0, "Hz", "hertz, hz"),
        (1.0 / 60.0, "Hz", "rpm, rev/min"),
        (1.0, "s", "seconds, second, sec, s"),
        (60.0, "s", "minutes, minute"),
        (3600.0, "s", "hours, hour, hr"),
        (1.0, "m", "meter, metre, meters, metres"),
        (1.0, "V", "volt, volts, v"),
        (1e-3, "V", "millivolt, millivolts"),
    )
    for spelling in spellings.split(", ")
}
_LOST = "\N{REPLACEMENT CHARACTER}"


@lru_cache(4096)
def unit_of(text: str) -> Unit:
    """Look a unit up as exports spell it; ``µ``, ``·`` and ``°`` may have been lost.

    Raises
    ------
    InputError
        It is not known.

    Examples
    --------
    >>> unit_of("[mN·m]").si, unit_of("rad s^-1").si, unit_of("hz").si, unit_of("Volts").si
    ('N m', 'rad/s', 'Hz', 'V')
    """
    name = repaired(text.strip()).strip("[](){}<>$\\ ").strip()
    if _LOST in name:  # only three signs outside ASCII occur in these units, each in a place of its own
        name = "°C" if name == f"{_LOST}C" else ("µ" + name[1:] if name.startswith(_LOST) else name)
        name = name.replace(_LOST, "·")
    if name == "mHz":  # its capitals mean a billion times as much
        return Unit(1e-3, "Hz")
    if name == "K":
        return Unit(1.0, "K")
    try:
        return unit(name or "1")
    except InputError:
        for spelling in (name, plain(name), re.sub(r"[$\\^{}]", "", name).strip()):
            if (known := _SPELLINGS.get(spelling.casefold())) is not None:
                return known
        raise


def fits(name: str, stated: str) -> bool:
    """Return whether a unit is one of a quantity."""
    try:
        return unit_of(stated).si in SI_OF.get(name, ())
    except InputError:
        return False


def signs_of(path: Path, cells: Sequence[str], decimal: str | None) -> Separators:
    """Decide the decimal and the thousands sign of a file from its cells of numbers, or from a stated decimal sign.

    SourceError where the cells are ambiguous, or show both signs as the decimal one.
    """
    if decimal is not None:
        other = "." if decimal == "," else ","
        has_other = any(other in c and c.strip("+-").replace(",", "").replace(".", "").isdigit() for c in cells)
        return Separators(decimal, other if has_other else "")
    if not any("," in cell for cell in cells):
        return DOT
    parts = (cell.strip().lower().partition("e") for cell in cells)
    try:  # no thousands sign stands before an exponent: one digit more makes that plain
        return separators(m + "0" if exponent and {",", "."} & set(m) else m for m, _, exponent in parts)
    except InputError as error:
        raise SourceError(path, str(error)) from None
