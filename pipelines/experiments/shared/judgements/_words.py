"""How a verdict spells numbers, chances and the beginnings of sentences."""

TIED = "\N{NO-BREAK SPACE}"  # a number stays with its unit
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


def of_error(unit: str) -> str:
    """Return the unit of an error of what is stated in a unit: a difference of temperatures is one in kelvin."""
    return "K" if unit == "degC" else unit
