"""Shared parts of the proposals of ``init``: words, lines, and file names.

Repeats are files whose names differ in their last number only. A drop height or a material in a
name (``7mm``, ``1p5 mm``, ``peek``) is taken as a proposal and marked as such. Values in no file are
written as :data:`labpipe.workflow.fields.GAP`; a person is asked for it, and the experiment waits until
it is filled.
"""

import math
import re
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import instruments
from labpipe.errors import LabpipeError
from labpipe.workflow import fields
from pipelines.experiments._kind import Found, Proposed

GAP = fields.GAP

SPHERE = f'''radius = "{GAP} mm"  # of the sphere, with ±, e.g. "9.525 ± 0.005 mm"'''
MOVING_MASS = f'''mass = "{GAP} g"  # of all that moves, sphere and holder, with ±, e.g. "505.0 ± 0.5 g"'''

_HEIGHT = re.compile(r"(?<![\d.,])(\d+(?:[.,p]\d+)?)[ _]*(mm|cm)(?![a-z])", re.IGNORECASE)
_REPEAT = re.compile(r"[_\- ]*(?:(?<![a-z])r|rep|run|repeat|test)?[_\- ]*\d+$", re.IGNORECASE)
_MARKS = re.compile(
    r"^(?:kopie|copy)(?:[ _-]*\(\d+\))?[ _-]+(?:von|of)[ _-]+"
    r"|[ _-]+(?:kopie|copy|neu|new|alt|old|final|wdh)(?=$|[ _-])|[ _-]*\(\d+\)$|[ _]*#(?=\d+$)",
    re.IGNORECASE,
)
"""Marks of a copy or of another try in the name of a file."""
_DEPTH = re.compile(r"[_\- ]*\d+(?:[.p]\d+)?\s*(?:um|µm|mm)?$", re.IGNORECASE)
_PLATE = re.compile(r"plate|vibration", re.IGNORECASE)
_UNDER = re.compile(r"under|disc|contact|below", re.IGNORECASE)
POLYMERS = {
    "acrylic": re.compile(r"acryl(?:ic|glas)?(?![a-z])|pmma|plexiglas|perspex", re.IGNORECASE),
    "peek": re.compile("peek", re.IGNORECASE),
    "nylon": re.compile(r"nylon|polyamide?(?![a-z])|(?<![a-z])pa[ _-]?66?(?!\d)", re.IGNORECASE),
    "ptfe": re.compile("ptfe|teflon", re.IGNORECASE),
    "nbr": re.compile("nbr|nitrile?(?![a-z])|perbunan", re.IGNORECASE),
}
"""Names of the polymers of the library in laboratories."""


def whole_stem(name: str) -> str:
    """Return a file's path without its suffix: the name of an experiment of one file."""
    return Path(name).with_suffix("").as_posix()


def without_repeat(name: str, number: re.Pattern[str] = _REPEAT) -> str:
    """Return the stem without the number of a repeat at its end, and without marks of a copy or another try.

    Examples
    --------
    >>> [without_repeat(name) for name in ("PMMA 1,5mm #2.csv", "Kopie (2) von pmma_7_3 neu.csv")]
    ['PMMA 1,5mm', 'pmma_7']
    """
    place, slash, stem = whole_stem(name).rpartition("/")
    marked = _MARKS.sub(lambda found: " " if "#" in found[0] else "", stem).strip() or stem
    return place + slash + (number.sub("", marked) or marked)


without_depth = partial(without_repeat, number=_DEPTH)
"""Return the stem without the depth or number at its end, and without the marks of :func:`without_repeat`."""


def grouped(names: Iterable[str], stem: Callable[[str], str]) -> Iterator[tuple[str, list[str]]]:
    """Yield stems and the files that have them, in the order of their names.

    Examples
    --------
    >>> list(grouped(["a_2.csv", "b.csv", "a_1.csv"], without_repeat))
    [('a', ['a_1.csv', 'a_2.csv']), ('b', ['b.csv'])]
    """
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(stem(name), []).append(name)
    for key in sorted(groups):
        yield key, sorted(groups[key])


Text = Callable[[Found, list[str], str], str]
"""Takes the scan, the files and the name of an experiment, and returns its tables of session.toml."""


def of_groups(
    stem: Callable[[str], str], ours: Callable[[Found, list[str]], list[str]] = lambda found, names: names
) -> Callable[[Text], Callable[[Found, Iterable[str]], Iterator[Proposed]]]:
    """Make of a text a proposal of an experiment for those of the files of each stem that are ``ours``."""

    def made(text: Text) -> Callable[[Found, Iterable[str]], Iterator[Proposed]]:
        def proposed(found: Found, names: Iterable[str]) -> Iterator[Proposed]:
            for key, group in grouped(names, stem):
                if files := ours(found, group):
                    yield Proposed(key, tuple(files), partial(text, found, files))

        return proposed

    return made


def identifier(stem: str) -> str:
    """Return the name that a stem gives an experiment."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", stem.rsplit("/", 1)[-1]).strip("_-") or "experiment"


def quoted(text: str) -> str:
    """Return a text escaped for the quotes of TOML."""
    return text.replace("\\", "\\\\").replace('"', '\\"')


def listed(names: Iterable[str]) -> str:
    """Return names as an array of TOML, one a line."""
    return "[\n" + "".join(f'  "{quoted(name)}",\n' for name in names) + "]"


def material_word(text: str, *, is_whole: bool = False) -> str | None:
    """Return the polymer that a text holds, or as a whole is, as the library calls it.

    Examples
    --------
    >>> material_word("laser/2024 PMMA #3"), material_word("PMMA rubber", is_whole=True)
    ('acrylic', None)
    """
    look = re.Pattern.fullmatch if is_whole else re.Pattern.search
    parts = reversed(text.split("/"))  # a file's own name tells more than its folder's
    return next((known for part in parts for known, called in POLYMERS.items() if look(called, part)), None)


def material_line(name: str, found: Found | None = None, *, is_shown: bool = False) -> str:
    """Return the lines of the material, from a file's name where it names one.

    A DMA export of the same material in the folder is preferred to the library, whose numbers are
    no measurement of it; where the material ``is_shown``, its name is stated too.
    """
    known = material_word(name)
    if known is None:
        other = "or any name, with material_from" if is_shown else "or use material_file"
        return f'material = "{GAP}"  # acrylic, peek, nylon, ptfe, nbr{";" if is_shown else ","} {other}'
    named = f'material = "{known}"  # proposed from the file name'
    if found is None or (measured := dma_of(known, found)) is None:
        return named
    of_dma = (
        f'material_from = "{measured}"  # the DMA experiment of the same material, by the file names\n'
        f'temperature = "{GAP} degC"  # of the specimen, with ±, e.g. "21.0 ± 0.5 degC"'
    )
    return f"{named}\n{of_dma}" if is_shown else of_dma


def dma_of(material: str, found: Found) -> str | None:
    """Name the DMA experiment that ``init`` proposes for a material.

    None unless exactly one file with sweeps is of it, and no other file could take its name.
    """
    sweeps = found.of("sweep")
    same = [name for name in sweeps if material_word(name) == material]
    if len(same) != 1:
        return None
    wanted = identifier(whole_stem(same[0]))
    others = {other for names in found.names.values() for other in names} - set(same)
    taken = {identifier(stem(other)) for other in others for stem in (whole_stem, without_repeat, without_depth)}
    return None if wanted in taken else wanted


def fall_shown(path: Path) -> float:
    """Return about how far a body fell along the line of sight [m], from its first to its last level; NaN if unknown.

    The level at the end is the lowest of the last tenth: bodies that still bounce touch the floor there.
    """
    import numpy as np  # which a plan does not need

    try:
        read: Any = instruments.read(path)
    except LabpipeError:
        return math.nan
    if "out1" not in read or read["out1"].attrs.get("units") != "m":
        return math.nan
    values = read["out1"].values[np.isfinite(read["out1"].values)]
    tenth = max(values.size // 10, 1)
    return abs(float(np.median(values[: max(tenth // 4, 1)]) - values[-tenth:].min())) if values.size else math.nan


def height_line(name: str, shown: float = math.nan) -> str:
    """Return the line of the drop height, where a file's name, or else its folder's, holds one length.

    A fall that the record shows [m] is added as a remark: it is no statement of the height.
    """
    seen = "" if math.isnan(shown) else f"; the record shows about {shown * 1e3:.2g} mm along the line of sight"
    for part in reversed(Path(whole_stem(name)).parts):
        lengths = set(_HEIGHT.findall(part))
        if len(lengths) == 1:
            number, unit = (text.lower().replace("p", ".").replace(",", ".") for text in lengths.pop())
            return f'height = "{number} {unit}"  # proposed from the file name; add ± u{seen}'
        if lengths:
            break
    return f'height = "{GAP} mm"  # fall from release to first touch, with ±, e.g. "1.500 ± 0.005 mm"{seen}'


def sees_plate(name: str) -> bool:
    """Return whether a file of the laser, or a record, is of the plate by its name."""
    return bool(_PLATE.search(name))


def is_slow(path: Path, slow: float = 0.1) -> bool:
    """Return whether readings come too rarely [s] for a drop to be seen; not when the file does not say."""
    try:
        found = instruments.read(path)
    except LabpipeError:
        return False
    return float(getattr(found, "attrs", {}).get("sampling_interval", 0.0)) >= slow


def view(film: str) -> str:
    """Return from where a film was taken by its name: ``under`` the disc, or the ``front``."""
    return "under" if _UNDER.search(film) else "front"
