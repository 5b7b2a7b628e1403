"""The material library: five materials, each number with its source.

A material is a TOML file (see ``library/*.toml``); a laboratory's own have the same form. Statuses are ``measured``,
``datasheet`` and ``estimate``: the five here are no measurement of the thesis's specimens.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from labpipe.errors import MATERIAL_FILE, NO_MATERIAL, InputError, SourceError
from labpipe.materials._shift_law import ShiftLaw, arrhenius, wlf
from labpipe.materials.prony import Prony
from labpipe.materials.superposition import MasterCurve
from labpipe.units import Measure, Quantity, quantity, require_positive, si

NAMES = ("nbr", "acrylic", "peek", "nylon", "ptfe")
_ALSO_CALLED = {
    **dict.fromkeys(("pmma", "plexiglas", "plexiglass", "perspex", "acrylglas"), "acrylic"),
    **dict.fromkeys(("pa", "pa66", "polyamide", "polyamid"), "nylon"),
    **dict.fromkeys(("nitrile", "nitril", "perbunan"), "nbr"),
    "teflon": "ptfe",
}
STATUSES = ("measured", "datasheet", "estimate")

_WHOLE = "labpipe/materials/library/acrylic.toml is a whole file of a material."
_LARGEST_FILE = 1 << 20  # bytes
_TABLES = {"labpipe_material", "name", "summary", "poisson", "density", "E_relaxed", "relaxation", "shift"}
_TABLES |= {"yield_stress"}


@dataclass(frozen=True, slots=True)
class Entry:
    """One number of a material: its value in SI, uncertainty, source and status."""

    name: str
    value: float
    u: float
    units: str
    source: str
    status: str


@dataclass(frozen=True, slots=True)
class YieldStress:
    """Yield stress of a polymer in uniaxial compression: ``value`` ± ``u`` [Pa] at a strain ``rate`` [1/s].

    It grows by ``per_decade`` [Pa] of the rate (Eyring); its source is among the entries of the material.
    """

    value: float
    u: float
    rate: float
    per_decade: float

    def at(self, rate: float) -> Quantity:
        """Return the yield stress at a strain rate [1/s]; a third of the growth is its uncertainty."""
        growth = self.per_decade * math.log10(rate / self.rate)
        return Quantity(self.value + growth, math.hypot(self.u, growth / 3.0), "Pa")


@dataclass(frozen=True, slots=True)
class Material:
    """A material with the origin of its numbers.

    ``prony`` is at the reference temperature ``T_ref`` [degC], about which the ``law`` is; ``entries`` are the numbers
    of its file; ``yield_stress`` is None where none is known, as of a rubber.
    """

    name: str
    summary: str
    prony: Prony
    entries: tuple[Entry, ...]
    T_ref: float
    law: ShiftLaw
    yield_stress: YieldStress | None = None

    def at(self, temperature: float | None) -> Prony:
        """Return the solid at a temperature [degC]; None is the reference.

        Raises
        ------
        InputError
            The law does not reach that temperature.
        """
        if temperature is None:
            return self.prony
        return self.prony.shifted(10.0 ** float(self.law.log10_aT(temperature)))


Solid = Prony | Material | MasterCurve | str | Path
"""Values of an argument ``material``: an object, a name of the library, or a TOML file."""


def solid(material: Solid, temperature: Measure | None = None) -> Prony:
    """Return the viscoelastic solid behind a name, a file or an object.

    Parameters
    ----------
    material : Prony, Material, MasterCurve, str or path-like
        ``nbr``, ``acrylic``, ``peek``, ``nylon`` or ``ptfe``, a material file that ends in
        ``.toml``, or an object; a Prony series is returned as it is.
    temperature : float or text with a unit, optional [degC]
        Where the material is; by default its reference temperature.

    Returns
    -------
    Prony

    Raises
    ------
    InputError
        There is no such material, or its law does not reach the temperature.
    SourceError
        The file cannot be read or does not describe a material.

    Examples
    --------
    >>> warm = solid("acrylic", temperature="39 °C")
    >>> bool(warm.relaxation(1e-3) < solid("acrylic").relaxation(1e-3))
    True
    """
    if isinstance(material, str | Path):
        material = describe(material)
    if isinstance(material, Material | MasterCurve):
        if temperature is None:
            return material.prony
        return material.at(si(temperature, "degC", "temperature"))
    if not hasattr(material, "creep_terms"):
        raise InputError(
            f"material: expected a name ({', '.join(NAMES)}), a .toml file, or a Prony series; "
            f"found {type(material).__name__}"
        )
    if temperature is not None:
        raise InputError("a Prony series knows no law of temperature; shift it (.shifted(a_T)), or give a name")
    return material


def load(name: str | Path, temperature: float | None = None) -> Prony:
    """Return a material of the library by its name, or of a TOML file, at a temperature [degC].

    See Also
    --------
    solid : the names, the errors, and the same of other objects.

    Examples
    --------
    >>> load("acrylic").nu
    0.35
    """
    return describe(name).at(temperature)


def describe(name: str | Path) -> Material:
    """Return a material of the library, or of a TOML file, with the origin of its numbers.

    Raises
    ------
    InputError
        There is no such material.
    SourceError
        With the line of the first mistake of a file.

    Examples
    --------
    >>> describe("PMMA").name, describe("Teflon").name, describe("PA 66").name
    ('acrylic', 'ptfe', 'nylon')
    """
    if isinstance(name, Path) or name.endswith(".toml"):
        return _read(Path(name))
    plain = name.strip().casefold()
    known = _ALSO_CALLED.get(plain.replace(" ", "").replace("-", ""), plain)
    if known not in NAMES:
        text = f'there is no material "{name}" in the library; known are {", ".join(NAMES)}'
        raise InputError(text).because(NO_MATERIAL)
    return _of_library(known)


@cache
def _of_library(name: str) -> Material:
    with resources.as_file(resources.files("labpipe.materials") / "library" / f"{name}.toml") as p:
        return _read(p)


def _read(path: Path) -> Material:
    """Read a material file."""
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise SourceError(path, "is larger than 1 MiB, which no material file is")
        text = path.read_text("utf-8")
        tree = tomllib.loads(text)
    except OSError as error:
        raise SourceError(path, f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise SourceError(path, "is not UTF-8 text") from None
    except tomllib.TOMLDecodeError as error:
        raise SourceError(path, f"is not TOML: {error}") from None
    return _Reader(path, text, tree).material()


class _Reader:
    """The checks of one file, with its lines at hand for messages."""

    def __init__(self, path: Path, text: str, tree: dict[str, Any]) -> None:
        self.path, self.lines, self.tree = path, [line.strip() for line in text.splitlines()], tree

    def fail(self, key: str, message: str) -> NoReturn:
        """Refuse the file, at the line of a key ("table.field"), else at that of its table."""
        table, _, field = key.partition(".")
        start = next((i for i, line in enumerate(self.lines) if line.startswith(f"[{table}]")), 0)
        end = next((i for i, line in enumerate(self.lines) if i > start > 0 and line.startswith("[")), len(self.lines))
        found = (i for i in range(start, end) if self.lines[i].startswith(field or table))
        raise SourceError(self.path, f"{key}: {message}", line=next(found, start) + 1, hint=_WHOLE).because(
            MATERIAL_FILE
        )

    def get(self, key: str) -> Any:
        table, _, field = key.partition(".")
        found = self.tree.get(table)
        if not isinstance(found, dict):
            self.fail(table, f"expected a table [{table}]")
        return found.get(field)

    def text(self, key: str) -> str:
        found = self.get(key)
        if not isinstance(found, str) or not found:
            self.fail(key, "expected text")
        return found

    def quantity(self, key: str, si: str) -> Quantity:
        text = self.text(key)
        try:
            found = quantity(text)
        except InputError as error:
            self.fail(key, str(error))
        if found.si != si:
            self.fail(key, f'expected a quantity in {si}, found "{text}"')
        return found

    def entry(self, name: str, si: str = "") -> Entry:
        """Return a number with its origin; without a unit the origin of a table of several."""
        found = self.quantity(f"{name}.value", si) if si else Quantity(math.nan, 0.0, "")
        source, status = self.text(f"{name}.source"), self.text(f"{name}.status")
        if status not in STATUSES:
            self.fail(f"{name}.status", f"expected one of {', '.join(STATUSES)}")
        return Entry(name, found.value, found.u, si, source, status)

    def numbers(self, key: str) -> list[float]:
        found = self.get(key)
        if not isinstance(found, list) or not all(type(x) in (int, float) and math.isfinite(x) for x in found):
            self.fail(key, "expected a list of finite numbers")
        return [float(x) for x in found]

    def shift(self) -> ShiftLaw:
        reference = self.quantity("shift.T_ref", "degC").value
        numbers: list[float] = []
        names = {"arrhenius": ("activation_energy",), "wlf": ("C1", "C2")}.get(str(self.get("shift.law")))
        if names is None:
            self.fail("shift.law", 'expected "arrhenius" or "wlf"')
        for name in names:
            value = self.get(f"shift.{name}")
            try:
                numbers.append(float(str(value).removesuffix("K")))
            except ValueError:
                self.fail(f"shift.{name}", f'expected a number, found "{value}"')
            if not numbers[-1] > 0:
                self.fail(f"shift.{name}", "expected a positive number")
        return arrhenius(numbers[0], reference) if len(names) == 1 else wlf(numbers[0], numbers[1], reference)

    def material(self) -> Material:
        unknown = set(self.tree) - _TABLES
        if unknown:
            self.fail(min(unknown), f"is unknown; known are {', '.join(sorted(_TABLES))}")
        if self.tree.get("labpipe_material") != 1:
            self.fail("labpipe_material", "expected 1, the version of this form")
        entries = [self.entry("poisson", "1"), self.entry("E_relaxed", "Pa")]
        rho, E = self.numbers("relaxation.rho"), self.numbers("relaxation.E")
        if len(rho) != len(E):
            self.fail("relaxation.E", f"{len(E)} moduli stand beside {len(rho)} times")
        try:
            prony = Prony(entries[1].value, np.array(E), np.array(rho), nu=entries[0].value)
        except InputError as error:
            self.fail("relaxation", str(error))
        law, flow = self.shift(), None
        entries += [self.entry("density", "kg/m3")] if "density" in self.tree else []
        entries += [self.entry("relaxation"), self.entry("shift")]
        if "yield_stress" in self.tree:
            entries.append(stress := self.entry("yield_stress", "Pa"))
            rate = self.quantity("yield_stress.rate", "1/s").value
            if min(stress.value, rate) <= 0.0:
                self.fail("yield_stress", "expected a positive stress and rate")
            flow = YieldStress(stress.value, stress.u, rate, self.quantity("yield_stress.per_decade", "Pa").value)
        name, summary = str(self.tree.get("name", self.path.stem)), str(self.tree.get("summary", ""))
        return Material(name, summary, prony, tuple(entries), law.T_ref, law, flow)


@dataclass(frozen=True, slots=True)
class Thermal:
    """Thermal properties of a solid: density [kg/m3], heat capacity [J/(kg K)], conductivity [W/(m K)].

    ``source`` and ``status`` (measured, datasheet or estimate) say where the numbers come from.
    """

    density: float
    heat_capacity: float
    conductivity: float
    source: str = "given"
    status: str = "measured"

    def __post_init__(self) -> None:
        require_positive(density=self.density, heat_capacity=self.heat_capacity, conductivity=self.conductivity)

    @property
    def diffusivity(self) -> float:
        """Thermal diffusivity in m2/s."""
        return self.conductivity / (self.density * self.heat_capacity)


# Heat capacity [J/(kg K)] and conductivity [W/(m K)]; grades differ by a tenth and more.
_HANDBOOK = "typical value of handbooks at 23 degC; the density is that of the library"
_KNOWN = {
    "nbr": (1950.0, 0.25),
    "acrylic": (1470.0, 0.19),
    "peek": (1340.0, 0.29),
    "nylon": (1700.0, 0.25),
    "ptfe": (1000.0, 0.25),
}


def thermal(name: str) -> Thermal:
    """Return the thermal properties of a material of the library; InputError where there are none of that name.

    Examples
    --------
    >>> round(thermal("acrylic").diffusivity * 1e6, 3)
    0.11
    """
    if name not in _KNOWN:
        raise InputError(
            f'no thermal properties of "{name}" are known, only of {", ".join(_KNOWN)}; give its '
            "density, heat capacity and conductivity"
        )
    density = next(e.value for e in describe(name).entries if e.name == "density")
    return Thermal(density, *_KNOWN[name], source=_HANDBOOK, status="estimate")
