"""How tables of a dynamic mechanical analysis name their columns and units.

Programs, supplements of papers and people write symbols (``E_stor``, ``G'``, ``log_aT``) as often
as words, and the unit in brackets, behind a slash or a comma, or as the end of the name
(``freq_hz``, ``G_storage_pa``). The case tells temperature ``T`` from time ``t``. Words in the
languages of the exports of instruments are known as well.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

from instruments import anton_paar
from instruments._symbols import FREQUENCIES, MODULI, RESPONSES, SHIFTS, TIMES, fold, named
from labpipe.errors import InputError
from labpipe.units import Unit, plain

#: What a reader of a message calls a quantity.
SPOKEN = {
    "frequency": "frequency",
    "angular_frequency": "frequency",
    "temperature": "temperature",
    "temperature_set": "set temperature",
    "time": "time",
    "interval_time": "time",
    "storage_modulus": "storage modulus",
    "loss_modulus": "loss modulus",
    "loss_factor": "tan δ",
    "phase_angle": "phase",
    "complex_modulus": "complex modulus",
    "storage_compliance": "storage compliance",
    "loss_compliance": "loss compliance",
    "complex_compliance": "complex compliance",
    "complex_viscosity": "complex viscosity",
    "complex_viscosity_real": "η′",
    "complex_viscosity_imaginary": "η″",
    "relaxation_modulus": "relaxation modulus",
    "creep_compliance": "creep compliance",
    "log10_aT": "log_aT",
    "ln_aT": "ln_aT",
    "a_T": "a_T",
    "b_T": "b_T",
}

#: SI unit that a known column must become.
SI_OF: dict[str, tuple[str, ...]] = {
    **anton_paar.SI_OF,
    **dict.fromkeys(("log10_aT", "ln_aT", "a_T", "b_T", "set"), ("1",)),
    **dict.fromkeys(("temperature", "temperature_set"), ("degC", "K", "degF")),
    **dict.fromkeys(("storage_compliance", "loss_compliance", "complex_compliance"), ("1/Pa",)),
    "angular_frequency": ("rad/s", "Hz", "1/s"),
}

# The wide brackets and letters of East Asian keyboards, and signs of one letter for two.
_WIDE = {code: code - 0xFEE0 for code in range(0xFF01, 0xFF5F)} | {0x2103: "°C", 0x2109: "°F", 0x3000: " "}
_WIDE |= {0x3390: "Hz", 0x3391: "kHz", 0x33A9: "Pa", 0x33AA: "kPa", 0x33AB: "MPa", 0x33AC: "GPa", 0x33AE: "rad/s"}
# Words that say of a symbol beside them no more than that it is a modulus.
_A_MODULUS = ("modulus", "modul", "module", "modulo", "moduli", "弾性率", "模量")
_LOGARITHM = re.compile(r"^(?:log10|log_10|log|lg)(?![a-z]{3})[\s_(|]*(.*?)\)?$", re.IGNORECASE)
_BRACKETS = re.compile(r"^(.*?\S)\s*[(\[{<]\s*([^()\[\]{}<>]*(?:\([^()]*\))?[^()\[\]{}<>]*)\s*[)\]}>]\s*$")
# Units of temperature in titles; a bare C is one only where no other reading is left.
DEGREES = r"°\s?[CF]|º[CF]|deg[CF]|K"
_AT = re.compile(
    r"\s*(?:^|[(\[@_]|\bat\b|\s(?=[\d.,]+\s*Hz))\s*@?\s*(?:[fT]\s*=\s*)?([+-]?[0-9]+(?:[.,][0-9]+)?(?:[eE][+-]?[0-9]+)?)\s*"
    rf"([mk]?Hz|rad/s|{DEGREES}|C)\s*[)\]]?(?=$|[\s/,_(\[])"
)
_POWER_OF_UNIT = re.compile(r"(?:(?:[x×*]\s*)?10\s*(?:\^|\*\*)?|1e)\s*([+-]?\d+)\s*[*·]?\s*([A-Za-z].*)")
_POWER = re.compile(r"10\^[+-]?\d+")  # of a loss factor
_OF_SEVERAL = re.compile(r"[\s_]+(?:mean|avg|average)$", re.IGNORECASE)  # readings or specimens
_PAIR = re.compile(r"^\(\s*['\"](.*?)['\"]\s*,\s*['\"](.*?)['\"]\s*\)$")  # ('f', 'Hz'), of pandas
_COMMENT = re.compile(r"^[#%!;/*]+\s*(?=\S)")

# Spellings of units beyond those of labpipe.units, which are unambiguous in such a table.
_SPELLINGS: dict[str, Unit] = {
    **dict.fromkeys(
        ("rad/sec", "rads-1", "radians/s", "radian/s", "rad/ s", "rad / s", "rad_s", "rads", "rad per s",
         "rad/second", "rps", "radpers", "rad_per_s", "radps", "r/s", "rad_sec"),
        Unit(1.0, "rad/s"),
    ),
    **dict.fromkeys(("1/sec",), Unit(1.0, "1/s")),
    **dict.fromkeys(
        ("deg C", "º C", "ºC", "oC", "° C", "celsius", "degrees C", "degree C", "deg. C", "deg_c", "degree celsius",
         "degrees celsius", "°c", "degc", "grad c", "deg.c", "°celsius", "^oc", "^circ c", "c°", "degreec",
         "˚c", "\u02da c", "?c",
         "\u00a1c", "cel"),
        Unit(1.0, "degC"),
    ),
    **dict.fromkeys(("kelvin", "°k", "deg k", "degk"), Unit(1.0, "K")),
    **dict.fromkeys(("°f", "degf", "deg f", "fahrenheit", "f"), Unit(1.0, "degF")),
    **dict.fromkeys(("degree", "degrees", "deg", "deg.", "°", "º", "˚"), Unit(0.017453292519943295, "rad")),
    **dict.fromkeys(("radian", "radians", "rad"), Unit(1.0, "rad")),
    **dict.fromkeys(("percent", "pct"), Unit(1e-2, "1")),
    **dict.fromkeys(("none", "n/a", "dimensionless", "unitless", "/", "a.u.", "--", "–", "—", "[-]"), Unit(1.0, "1")),
    **dict.fromkeys(("n/mm2", "mpascal", "megapascal", "MN/m2"), Unit(1e6, "Pa")),
    **dict.fromkeys(("kn/mm2", "gn/m2"), Unit(1e9, "Pa")),
    "n/cm2": Unit(1e4, "Pa"),
    "kn/m2": Unit(1e3, "Pa"),
    **dict.fromkeys(("kgf/cm2", "kg/cm2"), Unit(98066.5, "Pa")),
    **dict.fromkeys(("n/m2", "pascal", "pascals"), Unit(1.0, "Pa")),
    **dict.fromkeys(("dyn/cm2", "dyne/cm2", "dynes/cm2"), Unit(0.1, "Pa")),
    **dict.fromkeys(("psi", "lbf/in2", "lb/in2"), Unit(6894.757293168361, "Pa")),
    "ksi": Unit(6894757.293168361, "Pa"),
    "bar": Unit(1e5, "Pa"),
    "1/gpa": Unit(1e-9, "1/Pa"),
    "1/mpa": Unit(1e-6, "1/Pa"),
    "1/kpa": Unit(1e-3, "1/Pa"),
    **dict.fromkeys(("1/pa", "m2/n"), Unit(1.0, "1/Pa")),
    **dict.fromkeys(("cm2/dyn", "cm2/dyne"), Unit(10.0, "1/Pa")),
    **dict.fromkeys(("pa s", "pas", "pa s.", "pa sec", "n s/m2"), Unit(1.0, "Pa s")),
    **dict.fromkeys(("poise", "p"), Unit(0.1, "Pa s")),
    **dict.fromkeys(("hz", "hertz", "cps", "cycles/s"), Unit(1.0, "Hz")),
    "khz": Unit(1e3, "Hz"),
    **dict.fromkeys(("cpm", "cycles/min", "rpm", "rev/min", "r/min"), Unit(1.0 / 60.0, "Hz")),
    "гц": Unit(1.0, "Hz"),
    "рад/с": Unit(1.0, "rad/s"),
    "па": Unit(1.0, "Pa"),
    "кпа": Unit(1e3, "Pa"),
    "мпа": Unit(1e6, "Pa"),
    "гпа": Unit(1e9, "Pa"),
    **dict.fromkeys(("seconds", "second", "secs", "sec.", "sec", "s"), Unit(1.0, "s")),
    **dict.fromkeys(("minutes", "minute", "mins", "min.", "min"), Unit(60.0, "s")),
    **dict.fromkeys(("hours", "hour", "hr", "hrs", "h"), Unit(3600.0, "s")),
    **dict.fromkeys(("days", "day"), Unit(86400.0, "s")),
    "pa": Unit(1.0, "Pa"),
    "kpa": Unit(1e3, "Pa"),
    # Written all in small letters; a solid's modulus in millipascal does not exist.
    "mpa": Unit(1e6, "Pa"),
    "gpa": Unit(1e9, "Pa"),
    "c": Unit(1.0, "degC"),
    "k": Unit(1.0, "K"),
}  # fmt: skip


_FOLDED_SPELLINGS = {spelling.casefold(): unit for spelling, unit in _SPELLINGS.items()}


@dataclass(frozen=True, slots=True)
class Heading:
    """What the heading of a column says.

    ``name`` is canonical, or made of the heading where it is not known; ``unit`` as written, "" if
    it is not there. ``is_logarithm`` of a decimal logarithm. ``at`` is what a column belongs to,
    such as ``(1.0, "Hz")`` of ``E'(1.000 Hz)``.
    """

    text: str
    name: str
    unit: str = ""
    is_known: bool = False
    is_logarithm: bool = False
    at: tuple[float, str] | None = None


@lru_cache(4096)
def quantity(heading: str) -> str | None:
    """Return the canonical name of a column, or None when it is not known.

    A symbol may stand beside its word: ``Storage modulus (G')``, ``E' storage modulus``.

    Examples
    --------
    >>> quantity("E_stor"), quantity("Speichermodul"), quantity("Storage Modulus G'"), quantity("colour")
    ('storage_modulus', 'storage_modulus', 'storage_modulus', None)
    """
    heading = _OF_SEVERAL.sub("", heading)
    found = named(heading) or anton_paar.column_name(heading)
    if found is not None:
        return found if found in SI_OF or found == "point" else None  # not the time of day, which is text
    words = re.split(r"[\s,;:(\[-]+", heading.strip(" )]"))
    for k in range(1, len(words)):
        first, second = " ".join(words[:k]), " ".join(words[k:])
        if fold(first) in _A_MODULUS or fold(second) in _A_MODULUS:
            found = named(second if fold(first) in _A_MODULUS else first)
            if found is not None:
                return found
        one = named(first) or anton_paar.column_name(first)
        if one is not None and one == (named(second) or anton_paar.column_name(second)):
            return one
    return None


def unit_of(text: str) -> Unit:
    """Look a unit up, in the spellings of such tables too.

    Raises
    ------
    InputError
        It is not known.

    Examples
    --------
    >>> unit_of("rad s^-1").si, unit_of("hz").si, unit_of("MPa").factor
    ('rad/s', 'Hz', 1000000.0)
    """
    bare = text.strip().strip("[]{}<>$").strip()
    bare = bare[1:-1].strip() if bare.startswith("(") and bare.endswith(")") else bare
    if bare == "mHz":  # its capitals mean a billion times as much
        return Unit(1e-3, "Hz")
    if _POWER.fullmatch(bare):
        return Unit(10.0 ** int(bare[3:]), "1")
    power = _POWER_OF_UNIT.fullmatch(bare)
    if power:
        unit = unit_of(power[2])
        return Unit(unit.factor * 10.0 ** int(power[1]), unit.si)
    try:
        return anton_paar.unit_of(bare or "1")
    except InputError:
        marked = re.sub(r"[$\\^{}]|\\?circ|\\?degree(?=C)", "", bare)
        for spelling in (bare, plain(bare), marked.strip()):
            if spelling.casefold() in _FOLDED_SPELLINGS:
                return _FOLDED_SPELLINGS[spelling.casefold()]
        raise


def degrees(spelled: str) -> str:
    """Return the unit of a temperature in a title: ``° C`` is degC, ``°F`` degF, K itself."""
    return {"K": "K", "F": "degF"}.get(spelled[-1], "degC")


def fits(name: str, unit: str) -> bool:
    """Tell whether a unit is one of a quantity."""
    try:
        return unit_of(unit).si in SI_OF.get(name, ())
    except InputError:
        return False


def is_unit(cell: str) -> bool:
    """Tell whether a cell of a row of units can be one."""
    try:
        unit_of(cell)
    except InputError:
        return False
    return True


def parsed(heading: str) -> Heading:
    """Part a heading into quantity, unit, and what else it says.

    Examples
    --------
    >>> parsed("E' (MPa)").name, parsed("freq_hz").unit, parsed("E'(1.000 Hz)/MPa").at
    ('storage_modulus', 'hz', (1.0, 'Hz'))
    """
    text = _COMMENT.sub("", anton_paar.repaired(heading.translate(_WIDE).strip().strip("\ufeff"))).strip()
    text = _PAIR.sub(r"\1 (\2)", text)
    at = _AT.search(text)
    if at is not None:
        bare = (
            (text[: at.start()] + " " + text[at.end() :]).strip(" _-/,") if at.end() < len(text) else text[: at.start()]
        )
        inner = _known(text[: at.start()] + text[at.end() :])
        if inner is not None and bare:
            unit = at[2] if at[2].endswith(("Hz", "rad/s")) else degrees(at[2])
            return replace(inner, text=heading.strip(), at=(float(at[1].replace(",", ".")), unit))
    found = _known(text)
    if found is not None:
        return replace(found, text=heading.strip())
    bracket = _BRACKETS.match(text)
    name, unit = (bracket[1], bracket[2]) if bracket else (text, "")
    return Heading(heading.strip(), anton_paar.slug(name), unit)


def _known(text: str) -> Heading | None:
    """Find the first way to part a heading that gives a known quantity with a unit of it."""
    explicit: Heading | None = None
    for name, unit, is_explicit in _parts(text):
        found, is_log = quantity(name), False
        if found is None:
            match = _LOGARITHM.match(name.strip())
            found = quantity(match[1]) if match and match[1] else None
            is_log = found is not None
        if found is None:
            continue
        if found == "a_T" and is_log:
            found, is_log = "log10_aT", False
        made = Heading(text, found, unit, is_known=True, is_logarithm=is_log)
        if not unit or fits(found, unit):
            return made
        if is_explicit and explicit is None:
            explicit = made
    return explicit


def _parts(text: str) -> Iterator[tuple[str, str, bool]]:
    """Yield the ways to part a heading into name and unit, and whether a sign parts them."""
    bracket = _BRACKETS.match(text)
    if bracket:
        yield bracket[1], bracket[2], True
        again = _BRACKETS.match(bracket[1])
        if again and quantity(again[1]) is not None:
            yield again[1], bracket[2], True
    yield text, "", False
    yield from (
        (text[: m.start()], text[m.end() :], True) for m in reversed([*re.finditer(r"\s*/\s*", text)]) if m.start()
    )
    yield from ((text[: m.start()], text[m.end() :], True) for m in reversed([*re.finditer(r"\s*[,;:]\s*", text)]))
    yield from ((text[: m.start()], text[m.end() :], False) for m in re.finditer(r"\s+in\s+|_in_", text))
    yield from ((text[: m.start()], text[m.end() :], False) for m in re.finditer(r"[\s_.-]+", text) if m.start())
    yield from ((text[: m.start()], text[m.start() :], False) for m in re.finditer(r"(?<=[a-z])(?=[A-Z])", text))


def is_table(names: "set[str]") -> bool:
    """Tell whether columns are those of sweeps, of responses over time, or of a table of shifts.

    Examples
    --------
    >>> is_table({"frequency", "storage_modulus"}), is_table({"time", "temperature"})
    (True, False)
    """
    if "temperature" in names | {"temperature" if "temperature_set" in names else ""} and names & SHIFTS:
        return True
    if names & TIMES and names & RESPONSES:
        return True
    moduli = len(names & MODULI)
    damping = bool(names & {"loss_factor", "phase_angle"})
    return bool(moduli and (names & FREQUENCIES or names & {"temperature", "temperature_set"})) or (
        moduli >= 1 and (moduli + damping) >= 2 and bool(names & TIMES)
    )
