"""Headings of tables: the quantity, the unit, and the frequency or temperature that a column belongs to.

The unit is given in brackets, behind a slash or a comma, or as the end of the name (``freq_hz``, ``G_storage_pa``).
"""

import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

from instruments._quantities import TEMPERATURES, TEXT, is_unit, quantity, repaired, slug

_LOGARITHM = re.compile(r"^(?:log10|log_10|log|lg)(?![a-z]{3})[\s_(|]*(.*?)\)?$", re.IGNORECASE)
_BRACKETS = re.compile(r"^(.*?\S)\s*[(\[{<]\s*([^()\[\]{}<>]*)\s*[)\]}>]\s*(.*)$")
_DEGREES = r"°\s?[CF]|º\s?C|deg\s?[CF]|K"
_NUMBER = r"[+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?"
_PLACE = re.compile(rf"(?<![^\W_])(?<![.,])({_NUMBER})\s*({_DEGREES}|[mk]?Hz|rad/s|C)(?![^\W_]|/)")
_LAST = re.compile(r"^(.*\S)\s*[(\[{<]\s*([^()\[\]{}<>]*)\s*[)\]}>]\s*$")
_SIGNS = (r"\s*/\s*", r"\s*[,;:]\s*", r"\s+in\s+|_in_", r"[\s_]+")  # between name and unit, the first two explicit
_COMMENT = re.compile(r"^[#%!;/*]+\s*(?=\S)")
_OF_SEVERAL = re.compile(r"[\s_]+(?:mean|avg|average)$", re.IGNORECASE)  # readings or specimens
# A temperature or frequency with such a word is not that of the readings below.
_OF_ANOTHER = re.compile(
    r"\bref|glass|\bt[gm]\b|/\s*min|\bto\b|\bfrom\b|dried|drying|cur(?:ed|ing)|anneal|age(?:d|ing)|\bstart|\bend\b"
    r"|\bfinal\b|\binitial|\bambient|\broom|stored|storing|condition|humid|\bRH\b",
    re.IGNORECASE,
)
_FACT = re.compile(
    rf"(?:^|[\s;,(])(?P<key>[^\W\d_][^\W\d]*(?:[ .][^\W\d]+)?(?:\s*[\[(][^\])]*[\])])?)\s*(?:[:=\t,;]+|\s\s)\s*"
    rf"(?P<value>{_NUMBER})(?=[\s;,)°ºKC]|$|Hz|rad|deg)(?:[;,\t]?\s*(?P<unit>[°º]?\s?[A-Za-z/]{{1,5}})(?=[\s;,)]|$))?"
)
_PARAMETERS = re.compile(r"\s*[A-Za-z]\w*\s*=\s*[^=;]*;")  # key=value; of a RepTate header


@dataclass(frozen=True, slots=True)
class Heading:
    """The heading of a column: its text, and name, canonical or made of the text; ``unit`` as written, or "".

    ``at`` is the place that a column belongs to, such as ``(1.0, "Hz")`` of ``E'(1.000 Hz)``.
    """

    text: str
    name: str
    unit: str = ""
    is_known: bool = False
    is_logarithm: bool = False
    at: tuple[float, str] | None = None

    def with_unit(self, unit: str) -> "Heading":
        """Add the unit of a row below to a heading that states none; brackets may hold another word."""
        if not unit.strip() or (self.unit and is_unit(self.unit)):
            return self
        found = replace(self, unit=unit.strip())
        is_quotient = self.unit and f"({self.unit})" not in self.text and f"[{self.unit}]" not in self.text
        return replace(found, name=slug(self.text), is_known=False) if is_quotient else found  # G*/sin(delta)

    @property
    def place(self) -> str:
        """Quantity of ``at``."""
        return "frequency" if self.at is not None and self.at[1].endswith(("Hz", "rad/s")) else "temperature"


@lru_cache(4096)
def parsed(heading: str) -> Heading:
    """Part a heading into quantity, unit, and the place that it belongs to."""
    written = unicodedata.normalize("NFKC", repaired(heading.strip().strip("\ufeff"))).replace("\u2212", "-")
    text = _OF_SEVERAL.sub("", _COMMENT.sub("", written).strip())
    place = _PLACE.search(text)
    if place is not None:
        bare = re.sub(r"[(\[@]\s*[)\]]?\s*(?=$|[\s/,_(\[])|\bat\s*$", "", text[: place.start()] + text[place.end() :])
        inner = _known(re.sub(r"\(\s*\)|@\s*(?=\(|$)", "", bare).replace("__", "_").strip(" _@"))
        if inner is not None:
            value, unit = stated_place(place)
            return replace(inner, text=heading.strip(), at=(value, unit))
    found = _known(text)
    if found is not None:
        return replace(found, text=heading.strip())
    bracket = _BRACKETS.match(text)
    name, unit = (f"{bracket[1]} {bracket[3]}", bracket[2]) if bracket else (text, "")
    return Heading(heading.strip(), slug(name), unit)


def _known(text: str) -> Heading | None:
    """Find the first way to part a heading that gives a known quantity with a unit of it."""
    explicit: Heading | None = None
    for name, unit, is_explicit in _parts(text):
        found, is_log = quantity(name), False
        if found is None and (match := _LOGARITHM.match(name.strip())) and match[1]:
            found = quantity(match[1].strip(" )"))
            is_log = found is not None
        if found is None or found in TEXT:
            continue
        if found == "a_T" and is_log:
            found, is_log = "log10_aT", False
        made = Heading(text, found, unit, is_known=True, is_logarithm=is_log)
        if not unit or is_unit(unit, found):
            return made
        if is_explicit and explicit is None:
            explicit = made
    return explicit


def _parts(text: str) -> Iterator[tuple[str, str, bool]]:
    """Yield the ways to part a heading into name and unit, and whether a sign parts them."""
    bracket = _LAST.match(text)
    if bracket:
        yield bracket[1], bracket[2], True
        if (word := _LAST.match(bracket[1])) is not None:
            yield word[1], bracket[2], True  # Storage Modulus (E') (MPa)
    yield text, "", False
    for sign in _SIGNS:
        matches, is_explicit = list(re.finditer(sign, text)), sign in _SIGNS[:2]
        for m in reversed(matches) if is_explicit else matches:
            if m.start():
                yield text[: m.start()], text[m.end() :], is_explicit


def stated_place(match: "re.Match[str]") -> tuple[float, str]:
    """Return value and unit of a temperature or frequency in a line; a bare C is degC."""
    unit = re.sub(r"\s", "", match[2])
    if not unit.endswith(("Hz", "rad/s")):
        unit = {"K": "K", "F": "degF"}.get(unit[-1], "degC")
    return float(match[1].replace(",", ".")), unit


def stated_in_title(line: str) -> dict[str, tuple[float, str]]:
    """Return the one temperature or frequency that a title states: ``Isotherm at 20 °C``, ``--- 20 °C ---``."""
    places = list(_PLACE.finditer(re.sub(r"\s*(?:±|\+/-)\s*\d+(?:[.,]\d+)?", "", line.replace("--", " "))))
    if len(places) != 1 or _OF_ANOTHER.search(line):
        return {}
    value, unit = stated_place(places[0])
    return {"frequency" if unit.endswith(("Hz", "rad/s")) else "temperature": (value, unit)}


def is_of_parameters(line: str) -> bool:
    """Recognise the header of a RepTate file, ``T=20;Mw=94.9;``, whose columns are in rad/s and Pa."""
    return _PARAMETERS.match(line) is not None


def facts(line: str) -> dict[str, tuple[float, str]]:
    """Return temperature and frequency as a line above a table states them by name, with their unit."""
    found = {}
    is_parameters = is_of_parameters(line)
    for match in _FACT.finditer(_COMMENT.sub("", line)) if not _OF_ANOTHER.search(line) else ():
        heading = parsed(match["key"])
        if heading.name not in (*TEMPERATURES, "frequency"):
            continue
        unit = match["unit"] or heading.unit or ("degC" if is_parameters and heading.name == "temperature" else "")
        if unit and is_unit(unit, heading.name):
            found[heading.name.removesuffix("_set")] = (float(match["value"].replace(",", ".")), unit)
    return found
