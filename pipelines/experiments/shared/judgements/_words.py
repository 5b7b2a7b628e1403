"""How a verdict spells numbers, chances and the beginnings of sentences."""

import re

TIED = "\N{NO-BREAK SPACE}"  # a number stays with its unit
_NEGATIVE = re.compile(r"(?:(?<=^)|(?<=[ (\N{NO-BREAK SPACE}]))-(?=\d+(?:\.\d+)?(?:[ ,;:)\N{NO-BREAK SPACE}]|$))")
_LEAST_P = 1e-4  # smaller probabilities say no more


def probability(p: float) -> str:
    """Write a probability; one too small to tell from none is never written as 0.

    Examples
    --------
    >>> probability(0.82), probability(1e-120)
    ('0.82', '< 0.0001')
    """
    return f"{p:.2g}" if p >= _LEAST_P else f"< {_LEAST_P:g}"


def chance(p: float) -> str:
    """Say how likely what was found is: "p = 0.82", "p < 0.0001"."""
    return f"p = {probability(p)}" if p >= _LEAST_P else f"p {probability(p)}"


def capitalised(text: str) -> str:
    """Begin a sentence; files and settings keep their spelling.

    Examples
    --------
    >>> capitalised("the radius is wrong"), capitalised("sphere.radius is wrong")
    ('The radius is wrong', 'sphere.radius is wrong')
    """
    first = text.partition(" ")[0].rstrip(".,:;")
    return text if any(c in first for c in "/._") else text[:1].upper() + text[1:]


def with_minus(text: str) -> str:
    """Write the signs of negative numbers as minus signs; hyphens within words, files and quotes stay.

    Examples
    --------
    >>> with_minus('from -40.0 to -0.5 °C in drop-1.csv, 2024-05-14, where "-3" stands')
    'from −40.0 to −0.5 °C in drop-1.csv, 2024-05-14, where "-3" stands'
    """
    return _NEGATIVE.sub("\N{MINUS SIGN}", text)


def counted_from_one(setting: str) -> str:
    """Write the name of a setting as people count.

    Examples
    --------
    >>> counted_from_one("drops[0].height"), counted_from_one("sphere.mass")
    ('height of drops no. 1', 'sphere.mass')
    """
    listed = re.fullmatch(r"(\w+)\[(\d+)\](?:\.(.+))?", setting)
    if listed is None:
        return setting
    item = f"{listed[1]} no. {int(listed[2]) + 1}"
    return f"{listed[3]} of {item}" if listed[3] else item


def of_error(unit: str) -> str:
    """Return the unit of an error of what is stated in a unit: a difference of temperatures is one in kelvin."""
    return "K" if unit == "degC" else unit
