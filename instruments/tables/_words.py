"""How plain tables of a dynamic mechanical analysis name their columns.

Programs and supplements of papers write symbols (``E_stor``, ``G'``, ``log_aT``) as often as
words; the case tells temperature ``T`` from time ``t``. Words in the four languages of the
rheometer exports are known as well.
"""

import re

from instruments import anton_paar

#: Canonical name to the symbols that stand for it, folded by :func:`fold`.
SYMBOLS: dict[str, tuple[str, ...]] = {
    "frequency": ("f", "freq", "fset", "ν"),
    "angular_frequency": ("w", "omega", "ω"),
    "temperature": ("T", "temp", "tmeas"),
    "temperature_set": ("tset", "tround"),
    "time": ("t",),
    "storage_modulus": ("estor", "gstor", "e'", "g'", "estorage", "gstorage", "storage"),
    "loss_modulus": ("eloss", "gloss", "e''", "g''", "loss"),
    "loss_factor": ("tandelta", "tand", "tanδ", "tandel"),
    "set": ("set", "sweep", "isotherm"),
    "log10_aT": ("logat", "log10at", "lgat", "loga"),
    "ln_aT": ("lnat",),
    "a_T": ("at",),
    "b_T": ("bt",),
}

_NAME_OF = {symbol: name for name, symbols in SYMBOLS.items() for symbol in symbols}
_UNIT_IN_HEADING = re.compile(r"^(.*\S)\s*[\[(]([^\])]*)[\])]$")
# Primes of all sorts, and what folds away.
_PRIMES = {"\u2032": "'", "\u2033": "''", "\u2019": "'", '"': "''", "\u00b4": "'"}
_SHIFTS = ("log10_aT", "ln_aT", "a_T")


def fold(heading: str) -> str:
    """Reduce a heading to its symbol: primes alike, no separators; a lone letter keeps its case.

    Examples
    --------
    >>> fold("log_aT"), fold("E″"), fold("T"), fold("t")
    ('logat', "e''", 'T', 't')
    """
    text = heading.strip()
    for sign, plain in _PRIMES.items():
        text = text.replace(sign, plain)
    text = re.sub(r"[\s_().,|-]+", "", text)
    text = text.translate(str.maketrans("₁₀", "10"))
    return text if text in ("T", "t") else text.casefold()


def parted(heading: str) -> tuple[str, str]:
    """Part a heading from the unit that it may hold in brackets.

    Examples
    --------
    >>> parted("E' (MPa)"), parted("log(aT)"), parted("f")
    (("E'", 'MPa'), ('log(aT)', ''), ('f', ''))
    """
    match = _UNIT_IN_HEADING.match(heading.strip())
    if match is None or quantity(heading) is not None:
        return heading.strip(), ""
    return match[1], match[2]


def quantity(heading: str) -> str | None:
    """Return the canonical name of a column, or None when it is not known.

    Examples
    --------
    >>> quantity("E_stor"), quantity("Speichermodul"), quantity("colour")
    ('storage_modulus', 'storage_modulus', None)
    """
    return _NAME_OF.get(fold(heading)) or anton_paar.column_name(heading)


def delimiter_of(line: str) -> str:
    """Return what separates the headings of a first line: TAB, semicolon or comma ("" if none)."""
    found = max("\t;,", key=line.count)
    return found if found in line else ""


def is_table(names: "set[str | None]") -> bool:
    """Tell whether columns make sweeps (moduli over frequency) or a table of shifts."""
    has_frequency = bool(names & {"frequency", "angular_frequency"})
    is_sweep = {"storage_modulus", "loss_modulus", "temperature"} <= names and has_frequency
    return is_sweep or ("temperature" in names and bool(names & set(_SHIFTS)))


def recognises(first_line: str) -> bool:
    """Tell the first line of a plain table by the quantities that it names.

    Examples
    --------
    >>> recognises("f,E_stor,E_loss,T,Set"), recognises("T;log_aT"), recognises("x,y")
    (True, True, False)
    """
    delimiter = delimiter_of(first_line)
    if not delimiter:
        return False
    cells = [cell.strip().strip('"') for cell in first_line.split(delimiter)]
    return is_table({quantity(parted(cell)[0]) for cell in cells})
