"""Quantities that instruments tabulate: canonical names, SI units, and how exports spell them.

A spelling is compared folded (:func:`fold`): primes the same, without accents, blanks and punctuation, a lone letter
with its case, which separates temperature ``T`` from time ``t``. The words of all programs are in ``vocabulary.toml``.
"""

import re
import tomllib
import unicodedata
from functools import lru_cache
from pathlib import Path
from typing import Any

from labpipe.errors import InputError
from labpipe.units import Unit, plain, unit

#: Words of exports in all languages met: quantities with their SI units, units, labels.
WORDS: dict[str, Any] = tomllib.loads(Path(__file__).with_name("vocabulary.toml").read_text("utf-8"))
#: SI units that a quantity may become; another is a mistake in the file, not a conversion.
SI_OF = {name: tuple(known["si"]) for name, known in WORDS["quantities"].items() if known["si"]}
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
    """Reduce a heading to its spelling in the table."""
    text = heading.strip().translate(_PRIMES).replace("\u2217", "*").replace("\u0394", "δ")
    text = re.sub(r"(?<=\w\w)'s\b", "s", text)  # Young's
    text = "".join(c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
    text = _FOLDED_AWAY.sub("", text)
    return text if text in _CASED else text.casefold()


_NAME_OF = {fold(word): name for name, known in WORDS["quantities"].items() for word in known["words"]}


@lru_cache(4096)
def quantity(heading: str) -> str | None:
    """Return the canonical name of a quantity, perhaps with its symbol, ``Storage modulus (G')``; None of others."""
    words = re.split(r"[\s,;:(\[-]+", heading.strip(" )]"))
    parts = ({_NAME_OF.get(fold(" ".join(part))) for part in (words[:k], words[k:])} for k in range(1, len(words)))
    twice = (found.pop() for found in parts if len(found) == 1)
    return _NAME_OF.get(fold(heading)) or next(filter(None, twice), None)


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
_SPELLINGS = {word: Unit(row["factor"], row["si"]) for row in WORDS["units"]["spellings"] for word in row["words"]}
_LOST = "\N{REPLACEMENT CHARACTER}"


@lru_cache(4096)
def unit_of(text: str) -> Unit:
    """Look a unit up as exports spell it; ``µ``, ``·`` and ``°`` may have been lost. InputError for an unknown one."""
    name = repaired(text.strip()).strip("[](){}<>$\\ ").strip()
    if _LOST in name:  # only three signs outside ASCII occur in these units, each in a place of its own
        name = "°C" if name == f"{_LOST}C" else ("µ" + name[1:] if name.startswith(_LOST) else name)
        name = name.replace(_LOST, "·")
    if name in ("mHz", "K"):  # its capitals mean a billion times as much; a temperature is shifted by whoever reads it
        return Unit(1e-3, "Hz") if name == "mHz" else Unit(1.0, "K")
    try:
        return unit(name or "1")
    except InputError:
        for spelling in (name, plain(name), re.sub(r"[$\\^{}]", "", name).strip()):
            if (known := _SPELLINGS.get(spelling.casefold())) is not None:
                return known
        raise


def is_unit(stated: str, name: str = "") -> bool:
    """Return whether a text can be a unit, of a quantity where one is named."""
    try:
        si = unit_of(stated).si
    except InputError:
        return False
    return not name or si in SI_OF.get(name, ())


def is_begin(names: set[str]) -> bool:
    """Return whether a line with these quantities begins a table, complete or not."""
    moduli, has_temperature = names & MODULI, not names.isdisjoint(TEMPERATURES)
    if (has_temperature and names & SHIFTS) or (names & TIMES and names & RESPONSES):
        return True
    of_loss = names & {"loss_factor", "phase_angle"}
    return bool(moduli) and bool(has_temperature or names & FREQUENCIES or len(moduli | of_loss) > 1)
