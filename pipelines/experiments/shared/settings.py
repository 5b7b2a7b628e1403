"""Settings that several kinds of experiment share, each with its unit and its reason."""

import math
from datetime import date
from typing import Annotated, ClassVar, Literal

import msgspec

from labpipe.errors import InputError
from labpipe.units import Quantity
from labpipe.workflow import fields
from labpipe.workflow.exclusions import Exclusion, Note


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of session.toml; an unknown key is a mistake, not a wish. Of ``alternatives`` at most one is given."""

    alternatives: ClassVar[tuple[tuple[str, ...], ...]] = ()

    def __post_init__(self) -> None:
        """Refuse two alternatives, and ``columns`` that mean nothing before a file is read."""
        for names in self.alternatives:
            if len([name for name in names if getattr(self, name) is not None]) > 1:
                raise ValueError(f"give {' or '.join(names)}, not both")
        named_columns(getattr(self, "columns", None))


class Recorded(Table, frozen=True, kw_only=True):
    """Table of an experiment."""

    exclude: list[Exclusion] = []  #: recordings, readings or frames left out, each with a reason
    notes: list[Note] = []  #: dated remarks, shown on the page


class NamedColumn(Table, frozen=True, kw_only=True):
    """One column of a table that no reader recognises: its heading, or its number from 1, and its unit."""

    column: str | int  #: heading, or number from 1
    unit: str = ""  #: unit of its numbers, where the heading has none


Columns = Annotated[
    str | dict[str, str | int | NamedColumn],
    msgspec.Meta(description='columns such as { time = "Time (s)", displacement = "Position (m)" }'),
]
"""Columns of a table that no reader recognises, by name or, ``"f (Hz), E' (MPa), E'' (MPa), T (degC)"``, all in their
order with their units (:func:`instruments.tables.read`)."""


def named_columns(columns: Columns | None) -> str | dict[str, object] | None:
    """Return the columns as :func:`instruments.read` takes them; ValueError where they name no table that is read."""
    found: str | dict[str, object] | None = msgspec.to_builtins(columns)
    if found is not None:
        from instruments import tables  # which a session without such columns needs not load

        try:
            tables.chosen(found)
        except InputError as error:
            raise ValueError(str(error)) from None
    return found


class MaterialChoice(Table, frozen=True, kw_only=True):
    """Where the material comes from: exactly one of three.

    ``temperature`` shifts it by its law; without it, it is taken at its reference temperature.
    """

    alternatives: ClassVar = (("material", "material_file", "material_from"),)
    material: str | None = None  #: name in the library, such as acrylic
    material_file: fields.File | None = None  #: TOML file of a material
    material_from: fields.ExperimentName | None = None  #: DMA experiment of this session
    temperature: fields.Temperature | None = None  #: temperature of the specimen

    def __post_init__(self) -> None:
        """Refuse no source and more than one."""
        given = [s for s in (self.material, self.material_file, self.material_from) if s]
        if len(given) != 1:
            raise ValueError(
                "give exactly one of material (a name of the library), material_file "
                f"and material_from (a DMA experiment); found {len(given)}"
            )

    @property
    def source(self) -> str:
        """The material, its file or the DMA experiment, by the name that it has in the session."""
        return self.material or self.material_file or (self.material_from or "").removeprefix(fields.REFERENCE)


class Sphere(MaterialChoice, frozen=True, kw_only=True):
    """The falling body.

    ``temperature`` is read at the surface. Unless the sphere is ``homogeneous``, warmed or cooled through, its inside
    may have any temperature from there to ``ambient``, by default that of a laboratory (ISO 554: 20, 23 or 27 °C).
    """

    radius: Annotated[fields.Length, fields.POSITIVE]  #: radius of the sphere
    mass: Annotated[fields.Mass, fields.POSITIVE]  #: mass of all that moves, sphere and holder
    homogeneous: bool = False  #: warmed or cooled through
    ambient: fields.Temperature = Quantity(23.0, 2.0, "degC")  #: temperature of the room

    @property
    def inside(self) -> Quantity | None:
        """Temperature of the sphere: that of its surface, with the uncertainty of its inside.

        One within 95 % of the ambient one is that of a sphere at rest in the room. Of any other the range between
        surface and ambient is a rectangle on one side of the surface, whose second moment about it is a third of its
        square; no gradient is assumed.
        """
        surface, room = self.temperature, self.ambient
        if surface is None or self.homogeneous:
            return surface
        apart = surface.value - room.value
        if abs(apart) <= 2.0 * math.hypot(surface.u, room.u):
            return surface
        return Quantity(surface.value, math.hypot(surface.u, apart / math.sqrt(3.0)), surface.si)


class CounterBody(Table, frozen=True, kw_only=True):
    """The elastic flat under a sphere: Young's modulus and Poisson's ratio."""

    E: Annotated[fields.Modulus, fields.POSITIVE]  #: Young's modulus
    nu: Annotated[float, fields.Range(at_least=0.0, at_most=0.5)]  #: Poisson's ratio


Flat = Annotated[
    Literal["sapphire", "rigid"] | CounterBody,
    msgspec.Meta(description='"sapphire", "rigid", or a table such as { E = "70 ± 2 GPa", nu = 0.22 }'),
]
"""The flat under a sphere: sapphire of the library, a rigid one, or ``{ E = "70 ± 2 GPa", nu = 0.22 }``."""


class Keyence(Table, frozen=True, kw_only=True):
    """Settings that a laser export may lack; nothing here is guessed, and contradictions to the file are refused."""

    cycle: Annotated[fields.Time, fields.POSITIVE] | None = None  #: time between samples
    storage_factor: Annotated[int, fields.Range(at_least=1)] | None = None  #: samples per stored point; 1 if not given
    units: list[str] | None = None  #: unit of each output
    encoding: str | None = None  #: codec of the text, such as cp932
    decimal: Literal[".", ","] | None = None  #: decimal sign of the file
    columns: Columns | None = None  #: columns of a recorder's table


class Sensor(Table, frozen=True, kw_only=True):
    """Which output of the controller sees the holder, and which way it counts."""

    output: str = "out1"  #: output that sees the holder
    direction: Literal[1, -1] = 1  #: 1: the reading grows as the holder moves up; −1: it falls
    serial: str | None = None  #: serial number of the sensor; a calibration record of another one is refused


class OfLaser(Recorded, frozen=True, kw_only=True):
    """Recordings of the laser; their day is needed where the files carry none."""

    calibration: fields.File  #: calibration record of the laser
    measured_on: date | None = None  #: day of the measurement, for the validity of the record
    keyence: Keyence = Keyence()  #: what the laser's files lack
    sensor: Sensor = Sensor()  #: output and direction of the laser


class OfCamera(Recorded, frozen=True, kw_only=True):
    """A film; its day, for the validity of the record, is by default that of its trigger."""

    film: fields.File  #: the film
    camera: fields.File  #: calibration record of the camera
    measured_on: date | None = None  #: day of the film
    frame_rate: Annotated[fields.Frequency, fields.POSITIVE] | None = None  #: of exported images, which hold no time
    channel: Literal["red", "green", "blue"] | None = None  #: colour that is used of a film in colours


class Plate(Table, frozen=True, kw_only=True):
    """The plate under the sphere as a damped oscillator, when it is to be part of the model."""

    mass: Annotated[fields.Mass, fields.POSITIVE]  #: modal mass
    frequency: Annotated[fields.Frequency, fields.POSITIVE]  #: natural frequency
    damping_ratio: Annotated[fields.Dimensionless, fields.Range(at_least=0.0, below=1.0)]  #: share of critical damping


class SphereModel(Table, frozen=True, kw_only=True):
    """Simulation of a loaded sphere.

    ``profile`` is the gap's shape: the parabola of the thesis or the exact sphere (7e-4 in force
    at a contact radius of 0.8 mm).
    """

    profile: Literal["parabola", "sphere"] = "parabola"  #: shape of the gap
    gravity: Annotated[fields.Acceleration, fields.POSITIVE] = Quantity(9.81, 0.0, "m/s2")  #: that of the place


class DropModel(SphereModel, frozen=True, kw_only=True):
    """Simulation of the drop; gravity sets the impact speed."""

    solver: Literal["mdr", "rings"] = "mdr"  #: springs (mdr) or ring elements
    rtol: Annotated[float, fields.Range(above=0.0, at_most=1e-2)] = 1e-4  #: of restitution and peak force
