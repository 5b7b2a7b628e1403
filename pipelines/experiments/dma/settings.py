"""Settings of dynamic mechanical analysis: isothermal frequency sweeps to a master curve."""

from typing import Annotated, Literal, get_args

import msgspec

from labpipe.units import Quantity
from labpipe.workflow.fields import POSITIVE, Dimensionless, File, Length, Range, Temperature
from pipelines.experiments.shared.settings import Columns, Recorded, Table

Mode = Literal["tension", "bending", "shear", "torsion"]
MODES: tuple[str, ...] = get_args(Mode)
"""What a rheometer loads; the file tells at most whether it strains in shear."""


class Export(Table, frozen=True, kw_only=True):
    """Statements that a rheometer export may lack; nothing here is guessed."""

    encoding: str | None = None  #: codec of the text, such as cp932
    decimal: Literal[".", ","] | None = None  #: decimal sign of the file
    columns: Columns | None = None  #: columns of another table, { frequency = "drive (Hz)", … }
    allow_incomplete: bool = False  #: read an export that ends early


class Sweeps(Table, frozen=True, kw_only=True):
    """Which readings make one isothermal sweep."""

    tolerance: Annotated[float, Range(above=0.0, at_most=10.0)] = 1.5  #: K by which the temperature may stray
    fewest: Annotated[int, Range(at_least=2, at_most=1000)] = 3  #: frequencies that a sweep needs


class Fit(Table, frozen=True, kw_only=True):
    """How the sweeps are shifted.

    ``law`` "free" gives every temperature a shift of its own. ``vertical`` and ``delay`` "auto" are taken when
    Schwarz's criterion asks for them.
    """

    law: Literal["free", "wlf", "arrhenius"] = "free"
    vertical: Literal["auto", "none", "rho_T", "linear", "quadratic"] = "auto"
    delay: Literal["auto", "on", "off"] = "auto"


class Dimensions(Table, frozen=True, kw_only=True):
    """Dimensions of a specimen: length between the clamps, and width and thickness or diameter."""

    length: Annotated[Length, POSITIVE] | None = None  #: between the clamps
    width: Annotated[Length, POSITIVE] | None = None  #: of a bar
    thickness: Annotated[Length, POSITIVE] | None = None  #: of a bar
    diameter: Annotated[Length, POSITIVE] | None = None  #: of a rod

    def given(self) -> dict[str, Quantity]:
        """Return those that are stated, by their names."""
        return {name: value for name, value in msgspec.structs.asdict(self).items() if isinstance(value, Quantity)}


class Specimen(Dimensions, frozen=True, kw_only=True):
    """The specimen as measured, with ±; its form factor makes the rheometer's stiffness a modulus.

    ``entered`` has those dimensions that were entered in the rheometer otherwise: moduli are multiplied by the
    ratio of both form factors. The uncertainty of the form factor is one of all moduli.
    """

    entered: Dimensions = Dimensions()

    def __post_init__(self) -> None:
        """Refuse a specimen without a cross-section."""
        given = set(self.given())
        if given not in ({"length", "diameter"}, {"length", "width", "thickness"}):
            raise ValueError(
                "a specimen has length and diameter, or length, width and thickness; "
                f"found {', '.join(sorted(given)) or 'nothing'}"
            )
        if set(self.entered.given()) - given:
            extra = ", ".join(sorted(set(self.entered.given()) - given))
            raise ValueError(f"entered names {extra}, which the specimen has not")


class Dma(Recorded, frozen=True, kw_only=True):
    """Exports of one specimen: of an Anton Paar rheometer, or tables of another analyser.

    Few files distinguish the modes of loading; moduli are taken to tension, for shear by E = 2 (1 + ν) G. ``scale`` is
    the factor of all moduli; its uncertainty is that of the specimen's dimensions (in torsion a bar's stiffness goes
    with the fourth power of its thickness) and of the force; ``specimen`` instead states those dimensions. Relaxation
    and creep tests count as sweeps.
    """

    kind: Literal["dma"]
    rheometer: Annotated[list[File], msgspec.Meta(min_length=1)]  #: exports of one specimen
    mode: Mode  #: loading of the specimen
    nu: Annotated[Dimensionless, Range(at_least=0.0, at_most=0.5)]  #: Poisson's ratio, of the material too
    T_ref: Temperature | None = None  #: temperature of the master curve; else the middle isotherm
    scale: Annotated[Dimensionless, POSITIVE] = Quantity(1.0, 0.0, "1")  #: factor of all moduli
    specimen: Specimen | None = None  #: dimensions as measured
    temperature: Temperature | None = None  #: of files without such a column
    temperatures: list[Temperature] | None = None  #: of files at one temperature each, in their order
    export: Export = Export()  #: what the export lacks
    sweeps: Sweeps = Sweeps()  #: which readings make a sweep
    fit: Fit = Fit()  #: how sweeps are shifted

    def __post_init__(self) -> None:
        """Refuse a specimen whose form factor is not known."""
        if self.specimen is not None and self.mode == "shear":
            raise ValueError("specimen is for tension, bending and torsion; in shear give scale, with ±")

    @property
    def is_shear(self) -> bool:
        """Whether a shear modulus is measured."""
        return self.mode in ("shear", "torsion")
