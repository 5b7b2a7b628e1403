"""Table of units: every accepted spelling and its factor to SI.

Inside labpipe every number is SI; units live at the edges. A spelling that is not in the table is refused, never
guessed. Temperatures are kept in °C as the field does (``degC``); everything else is a pure factor.
"""

import math
import re
from typing import NamedTuple

from labpipe.errors import InputError

ZERO_CELSIUS = 273.15
"""0 °C in kelvin."""


class Unit(NamedTuple):
    """One unit: its factor to SI and the SI unit it becomes."""

    factor: float
    si: str


#: SI unit to the units that become it, each with its factor.
_MULTIPLES: dict[str, dict[str, float]] = {
    "1": {"1": 1.0, "%": 1e-2, "counts": 1.0, "cycles": 1.0},
    "px": {"px": 1.0},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "Hz": {"Hz": 1.0, "kHz": 1e3, "fps": 1.0},
    "1/s": {"1/s": 1.0, "1/min": 1 / 60},
    "rad/s": {"rad/s": 1.0, "deg/s": 0.017453292519943295},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9},
    "m2": {"m2": 1.0, "mm2": 1e-6},
    "m/px": {"m/px": 1.0, "mm/px": 1e-3, "um/px": 1e-6},
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "um/s": 1e-6},
    "m/s2": {"m/s2": 1.0, "km/s2": 1e3},
    "kg": {"kg": 1.0, "g": 1e-3, "mg": 1e-6},
    "kg/m3": {"kg/m3": 1.0, "g/cm3": 1e3},
    "N": {"N": 1.0, "mN": 1e-3, "uN": 1e-6, "kN": 1e3, "gf": 9.80665e-3, "kgf": 9.80665},
    "N/m": {"N/m": 1.0, "kN/m": 1e3, "N/mm": 1e3},
    "N/s": {"N/min": 1 / 60, "gf/min": 9.80665e-3 / 60},
    "N m": {"N m": 1.0, "N mm": 1e-3, "mN m": 1e-3, "uN m": 1e-6, "nN m": 1e-9},
    "Pa": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9},
    "1/Pa": {"1/Pa": 1.0, "1/kPa": 1e-3, "1/MPa": 1e-6, "1/GPa": 1e-9},
    "Pa s": {"Pa s": 1.0, "uPa s": 1e-6, "mPa s": 1e-3, "kPa s": 1e3, "MPa s": 1e6},
    "J": {"J": 1.0, "mJ": 1e-3, "uJ": 1e-6},
    "J/m": {"J/m": 1.0},
    "J/m2": {"J/m2": 1.0, "mJ/m2": 1e-3},
    "J/kg/K": {"J/kg/K": 1.0},
    "W/m/K": {"W/m/K": 1.0},
    "rad": {"rad": 1.0, "deg": 0.017453292519943295, "mrad": 1e-3},
    "degC": {"degC": 1.0},
    "V": {"V": 1.0, "mV": 1e-3},
    "m/V": {"m/V": 1.0, "mm/V": 1e-3},
}
_TABLE = {name: (factor, si) for si, multiples in _MULTIPLES.items() for name, factor in multiples.items()}

#: Unit to its other spellings, beyond those that :func:`plain` makes one.
_SPELLINGS = {
    "1": ("", "-"),
    "degC": ("°C", "℃", "C"),
    "deg": ("°",),
    "s": ("sec",),
    "um": ("micron",),
    "1/MPa": ("1/Mpa",),
}
_ALIASES = {spelling: name for name, spellings in _SPELLINGS.items() for spelling in spellings}

# The micro sign, Greek mu and the mojibake of cp932 read as cp1252 are all one prefix.
_SIGNS = {"ƒÊ": "u", "\u00b5": "u", "\u03bc": "u", "⁻": "-", "¹": "1", "²": "2", "³": "3"}
_TOGETHER = re.compile(r"^([mun]?(?:N|Pa))(mm?|s)$")
_PRODUCT = re.compile(r"(?<=[A-Za-z])\s?[·\u22c5\u2219.*-]\s?(?=[A-Za-z])")
_INVERSE = re.compile(r"(^|\S) ?\b([A-Za-z]+)-(?:1|(2))$")


def plain(text: str) -> str:
    """Spell powers, products and the prefix of a millionth in one way.

    Examples
    --------
    >>> plain("µN.m"), plain("rad·s⁻¹"), plain("N mm^-2"), plain("MPa-1"), plain("m/s²"), plain("Nmm")
    ('uN m', 'rad/s', 'N/mm2', '1/MPa', 'm/s2', 'N mm')
    """
    for sign, ours in _SIGNS.items():
        text = text.replace(sign, ours)
    text = _TOGETHER.sub(r"\1 \2", re.sub(r"pixels?", "px", text))
    text = _PRODUCT.sub(" ", re.sub(r"\^(?=[-\d])", "", text))
    return _INVERSE.sub(lambda found: f"{found[1] or '1'}/{found[2]}{found[3] or ''}", text)


def unit(text: str) -> Unit:
    """Look a spelling up, with or without brackets: ``"[µN·m]"``, ``"gf"``, ``"mm"``.

    Raises InputError: it is not in the table.

    Examples
    --------
    >>> unit("gf")
    Unit(factor=0.00980665, si='N')
    >>> unit("[µm]").si
    'm'
    """
    name = text.strip().strip("[]()").strip()
    name = plain(_ALIASES.get(name, name))
    name = _ALIASES.get(name, name)
    if name not in _TABLE:
        raise InputError(f'unknown unit "{text}"; known units: {", ".join(sorted(_TABLE))}')
    return Unit(*_TABLE[name])


def spellings(si: str) -> tuple[str, ...]:
    """List the spellings of the table that become a given SI unit.

    Examples
    --------
    >>> spellings("rad")
    ('rad', 'deg', 'mrad')
    """
    return tuple(name for name, (_, becomes) in _TABLE.items() if becomes == si)


_NUMBER = r"(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?"
_QUANTITY = re.compile(
    rf"^\s*(?P<value>[+-]?{_NUMBER})"
    rf"(?:\s*(?P<first>[^\s\d±+-][^\d±+-]*?)?\s*(?:±|\+/-|\+-)\s*(?P<u>{_NUMBER}))?"
    r"\s*(?P<unit>\S.*?)?\s*$"
)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
"""A comma that may group thousands as well as stand before decimals."""


class Quantity(NamedTuple):
    """A value with its standard uncertainty, both in SI; as text for people, ``9.525 mm`` or ``12 ± 0.2 deg``.

    Examples
    --------
    >>> print(Quantity(0.009525, 0.0, "m"))
    9.525 mm
    """

    value: float
    u: float
    si: str

    def __str__(self) -> str:
        """Write it in the largest multiple by a power of a thousand in which it is at least 1."""
        names = {unit(name).factor: name for name in spellings(self.si) if name.endswith(self.si.removeprefix("k"))}
        names = {math.radians(1.0): "deg"} if self.si == "rad" else names or {1.0: self.si}
        factors = sorted(one for one in names if math.log10(one) % 3 == 0) or list(names)
        fitting = [one for one in factors if abs(self.value) >= one * (1 - 1e-12) or one == factors[0]]
        factor = (fitting if self.value else factors)[-1]
        text = f"{self.value / factor:.6g}" + (f" ± {self.u / factor:.2g}" if self.u else "")
        return text if names[factor] == "1" else f"{text} {names[factor]}"


def quantity(text: str) -> Quantity:
    """Parse ``"1.5 mm"``, ``"12.0 ± 0.2 deg"`` or ``"12 ± 0,2°"`` into SI.

    The number after ``±`` is the standard uncertainty (one sigma); without it, it is zero. The unit
    may stand after both numbers. A comma separates decimals; one that may as well group
    thousands, as in ``"1,500 mm"``, is refused.

    Raises InputError: the text is not a number with a known unit, or its comma has two meanings.

    Examples
    --------
    >>> quantity("1.5 mm")
    Quantity(value=0.0015, u=0.0, si='m')
    >>> quantity("1,5 mm ± 0,5 mm")
    Quantity(value=0.0015, u=0.0005, si='m')
    """
    match = _QUANTITY.match(text)
    if match is None:
        raise InputError(f'expected a number with a unit such as "1.5 mm" or "12.0 ± 0.2 deg", found "{text}"')
    numbers = [match["value"], match["u"] or "0"]
    commas = [number for number in numbers if "," in number]
    if commas and all("," not in number or _THOUSANDS.fullmatch(number) for number in numbers):
        raise InputError(
            f'the comma of "{text}" may stand before decimals or group thousands; '
            f"write {commas[0].replace(',', '.')} or {commas[0].replace(',', '')}"
        )
    factor, si = unit(match["unit"] or "1")
    if match["first"] and unit(match["first"]) != (factor, si):
        raise InputError(f'"{text}" has two units; write both numbers in one')
    value, u = (float(number.replace(",", ".")) for number in numbers)
    return Quantity(value * factor, u * factor, si)


Measure = float | str | Quantity
"""What an argument takes: a number in SI, or a text with a unit such as ``"9.525 mm"``."""


def si(given: Measure, unit_of: str, name: str) -> float:
    """Return an argument in SI: a number in SI, or a text with a unit; an uncertainty after ``±`` is refused.

    ``unit_of`` is the SI unit of the argument, or several that mean the same, ``"m or m/px"``; ``name`` is that of the
    argument, for the message. Raises InputError: it is neither, has no unit, is in the unit of something else, or
    states an uncertainty, which one computation does not propagate.

    Examples
    --------
    >>> si("9.525 mm", "m", "radius"), si("505 g", "kg", "mass"), si(0.5, "s", "duration")
    (0.009525, 0.505, 0.5)
    """
    first = unit_of.partition(" or ")[0]
    usual = {"m": "9.5 mm", "kg": "505 g", "s": "0.5 s", "Pa": "3.2 GPa", "degC": "39 °C"}.get(first, f"1 {first}")
    expected = f'expected a number in {unit_of}, or a text with a unit such as "{usual}"'
    if not isinstance(given, str | Quantity):
        try:
            return float(given)
        except (TypeError, ValueError):
            raise InputError(f"{name}: {expected}; found {type(given).__name__}") from None
    try:
        value, u, found = quantity(given) if isinstance(given, str) else given
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    text = f'"{given}"' if isinstance(given, str) else f"{value:g} {f'± {u:g} ' if u else ''}{found}"
    if u > 0.0:
        raise InputError(
            f"{name}: {text} states an uncertainty, and one computation does not propagate it; give the value alone. "
            "A session propagates the uncertainties of its inputs (process, sensitivity), a sweep samples them"
        )
    if found not in unit_of.split(" or "):
        raise InputError(f"{name}: {text} {'has no unit' if found == '1' else f'is in {found}'}; {expected}")
    return value


def require_positive(unit: str = "", **values: float) -> None:
    """Refuse arguments that are no positive, finite numbers, naming the first; ``unit`` is said with them."""
    for name, value in values.items():
        if not 0.0 < value < math.inf:
            raise InputError(f"{name} is {value}{unit and f' {unit}'}, expected a positive number")
