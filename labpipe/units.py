"""Table of units: every accepted spelling and its factor to SI.

Inside labpipe every number is SI; units live at the edges. A spelling that is not in the
table is refused, never guessed. Temperatures are kept in °C as the field does (``degC``);
everything else is a pure factor.
"""

import re
from typing import NamedTuple

from labpipe.errors import InputError


class Unit(NamedTuple):
    """One unit: its factor to SI and the SI unit it becomes."""

    factor: float
    si: str


_TABLE: dict[str, tuple[float, str]] = {
    "1": (1.0, "1"),
    "%": (1e-2, "1"),
    "counts": (1.0, "1"),
    "px": (1.0, "px"),
    "cycles": (1.0, "1"),
    "s": (1.0, "s"),
    "ms": (1e-3, "s"),
    "us": (1e-6, "s"),
    "ns": (1e-9, "s"),
    "min": (60.0, "s"),
    "h": (3600.0, "s"),
    "Hz": (1.0, "Hz"),
    "kHz": (1e3, "Hz"),
    "1/s": (1.0, "1/s"),
    "rad/s": (1.0, "rad/s"),
    "fps": (1.0, "Hz"),
    "m": (1.0, "m"),
    "cm": (1e-2, "m"),
    "mm": (1e-3, "m"),
    "um": (1e-6, "m"),
    "nm": (1e-9, "m"),
    "m2": (1.0, "m2"),
    "mm2": (1e-6, "m2"),
    "m/px": (1.0, "m/px"),
    "mm/px": (1e-3, "m/px"),
    "um/px": (1e-6, "m/px"),
    "m/s": (1.0, "m/s"),
    "cm/s": (1e-2, "m/s"),
    "mm/s": (1e-3, "m/s"),
    "um/s": (1e-6, "m/s"),
    "m/s2": (1.0, "m/s2"),
    "km/s2": (1e3, "m/s2"),
    "kg": (1.0, "kg"),
    "g": (1e-3, "kg"),
    "mg": (1e-6, "kg"),
    "kg/m3": (1.0, "kg/m3"),
    "g/cm3": (1e3, "kg/m3"),
    "N": (1.0, "N"),
    "mN": (1e-3, "N"),
    "uN": (1e-6, "N"),
    "kN": (1e3, "N"),
    "gf": (9.80665e-3, "N"),
    "kgf": (9.80665, "N"),
    "N/m": (1.0, "N/m"),
    "N/mm": (1e3, "N/m"),
    "N/min": (1 / 60, "N/s"),
    "gf/min": (9.80665e-3 / 60, "N/s"),
    "N m": (1.0, "N m"),
    "N mm": (1e-3, "N m"),
    "mN m": (1e-3, "N m"),
    "uN m": (1e-6, "N m"),
    "nN m": (1e-9, "N m"),
    "Pa": (1.0, "Pa"),
    "kPa": (1e3, "Pa"),
    "MPa": (1e6, "Pa"),
    "GPa": (1e9, "Pa"),
    "1/Pa": (1.0, "1/Pa"),
    "1/MPa": (1e-6, "1/Pa"),
    "Pa s": (1.0, "Pa s"),
    "mPa s": (1e-3, "Pa s"),
    "J": (1.0, "J"),
    "mJ": (1e-3, "J"),
    "J/m": (1.0, "J/m"),
    "J/m2": (1.0, "J/m2"),
    "mJ/m2": (1e-3, "J/m2"),
    "J/kg/K": (1.0, "J/kg/K"),
    "W/m/K": (1.0, "W/m/K"),
    "rad": (1.0, "rad"),
    "deg": (0.017453292519943295, "rad"),
    "mrad": (1e-3, "rad"),
    "deg/s": (0.017453292519943295, "rad/s"),
    "degC": (1.0, "degC"),
    "V": (1.0, "V"),
    "mV": (1e-3, "V"),
    "m/V": (1.0, "m/V"),
    "mm/V": (1e-3, "m/V"),
}

_ALIASES: dict[str, str] = {
    "": "1",
    "-": "1",
    "°C": "degC",
    "℃": "degC",
    "C": "degC",
    "°": "deg",
    "sec": "s",
    "min-1": "1/min",
    "μm": "um",
    "um/pixel": "um/px",
    "mm/pixel": "mm/px",
    "m/pixel": "m/px",
    "pixel": "px",
    "pixels": "px",
    "micron": "um",
    "m/s^2": "m/s2",
    "m/s²": "m/s2",
    "km/s^2": "km/s2",
    "km/s²": "km/s2",
    "m²": "m2",
    "mm²": "mm2",
    "m^2": "m2",
    "mm^2": "mm2",
    "g/cm³": "g/cm3",
    "g/cm^3": "g/cm3",
    "kg/m³": "kg/m3",
    "kg/m^3": "kg/m3",
    "N-mm": "N mm",
    "N·mm": "N mm",
    "N.mm": "N mm",
    "Nmm": "N mm",
    "N·m": "N m",
    "Nm": "N m",
    "N-m": "N m",
    "mN·m": "mN m",
    "mNm": "mN m",
    "uN·m": "uN m",
    "uNm": "uN m",
    "nN·m": "nN m",
    "nNm": "nN m",
    "Pa·s": "Pa s",
    "Pas": "Pa s",
    "mPa·s": "mPa s",
    "mPas": "mPa s",
    "s-1": "1/s",
    "1/Mpa": "1/MPa",
}


def unit(text: str) -> Unit:
    """Look a spelling up.

    Parameters
    ----------
    text : str
        As written in a file, with or without brackets: ``"[µN·m]"``, ``"gf"``, ``"mm"``.

    Returns
    -------
    Unit
        Factor to SI and the SI unit's name.

    Raises
    ------
    InputError
        The spelling is not in the table.

    Examples
    --------
    >>> unit("gf")
    Unit(factor=0.00980665, si='N')
    >>> unit("[µm]").si
    'm'
    """
    name = text.strip().strip("[]()").strip()
    # The micro sign, Greek mu and the mojibake of cp932 read as cp1252 are all one prefix.
    name = name.replace("ƒÊ", "u").replace("\u00b5", "u").replace("\u03bc", "u")
    name = name.replace("\u22c5", "·").replace("\u2219", "·")
    name = _ALIASES.get(name, name)
    try:
        return Unit(*_TABLE[name])
    except KeyError:
        known = ", ".join(sorted(_TABLE))
        message = f'unknown unit "{text}"; known units: {known}'
        raise InputError(message) from None


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
    """A value with its standard uncertainty, both in SI."""

    value: float
    u: float
    si: str


def quantity(text: str) -> Quantity:
    """Parse ``"1.5 mm"``, ``"12.0 ± 0.2 deg"`` or ``"12 ± 0,2°"`` into SI.

    The number after ``±`` is the standard uncertainty (one sigma); without it, it is zero. The unit
    may stand after both numbers. A comma stands before decimals; one that may as well group
    thousands, as in ``"1,500 mm"``, is refused.

    Raises
    ------
    InputError
        The text is not a number with a known unit, or its comma has two meanings.

    Examples
    --------
    >>> quantity("1.5 mm")
    Quantity(value=0.0015, u=0.0, si='m')
    >>> quantity("1,5 mm ± 0,5 mm")
    Quantity(value=0.0015, u=0.0005, si='m')
    """
    match = _QUANTITY.match(text)
    if match is None:
        message = f'expected a number with a unit such as "1.5 mm" or "12.0 ± 0.2 deg", found "{text}"'
        raise InputError(message)
    numbers = [match["value"], match["u"] or "0"]
    has_two_meanings = all("," not in number or _THOUSANDS.fullmatch(number) for number in numbers)
    if has_two_meanings and any("," in number for number in numbers):
        first = next(number for number in numbers if "," in number)
        message = (
            f'the comma of "{text}" may stand before decimals or group thousands; '
            f"write {first.replace(',', '.')} or {first.replace(',', '')}"
        )
        raise InputError(message)
    factor, si = unit(match["unit"] or "1")
    if match["first"] and unit(match["first"]) != (factor, si):
        message = f'"{text}" has two units; write both numbers in one'
        raise InputError(message)
    value, u = (float(number.replace(",", ".")) for number in numbers)
    return Quantity(value * factor, u * factor, si)


Measure = float | str | Quantity
"""What an argument takes: a number in SI, or a text with a unit such as ``"9.525 mm"``."""


def si(given: Measure, unit_of: str, name: str) -> float:
    """Return an argument in SI.

    Parameters
    ----------
    given : float, str or Quantity
        A number in SI, or a text with a unit; what stands after ``±`` is left aside.
    unit_of : str
        The SI unit of the argument; several that mean the same, ``"m or m/px"``.
    name : str
        Of the argument, for the message.

    Raises
    ------
    InputError
        It is neither, has no unit, or is in the unit of something else.

    Examples
    --------
    >>> si("9.525 mm", "m", "radius"), si("505 ± 0.5 g", "kg", "mass"), si(0.5, "s", "duration")
    (0.009525, 0.505, 0.5)
    """
    if not isinstance(given, str | Quantity):
        try:
            return float(given)
        except (TypeError, ValueError):
            message = f"{name}: expected {_example(unit_of)}; found {type(given).__name__}"
            raise InputError(message) from None
    try:
        value, _, found = quantity(given) if isinstance(given, str) else given
    except InputError as error:
        message = f"{name}: {error}"
        raise InputError(message) from None
    if found not in unit_of.split(" or "):
        text = f'"{given}"' if isinstance(given, str) else f"{value:g} {found}"
        is_in = "has no unit" if found == "1" else f"is in {found}"
        message = f"{name}: {text} {is_in}; expected {_example(unit_of)}"
        raise InputError(message)
    return value


def _example(unit_of: str) -> str:
    """Say what an argument takes, with an example in the unit that laboratories write."""
    first = unit_of.partition(" or ")[0]
    usual = {"m": "9.5 mm", "kg": "505 g", "s": "0.5 s", "Pa": "3.2 GPa", "degC": "39 °C"}
    text = usual.get(first, f"1 {first}")
    return f'a number in {unit_of}, or a text with a unit such as "{text}"'
