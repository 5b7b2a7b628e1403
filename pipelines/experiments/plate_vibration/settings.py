"""Settings of a plate vibration: the laser on the plate while spheres fall on it."""

from typing import Annotated, Literal

import msgspec

from labpipe.workflow.fields import POSITIVE, ExperimentName, File, Length, Mass, Temperature
from pipelines.experiments.shared.settings import DropModel, Flat, MaterialChoice, OfLaser, Table


class FallingBody(Table, frozen=True, kw_only=True):
    """The body that falls in every drop; ``mass`` is all that moves, sphere and holder."""

    radius: Annotated[Length, POSITIVE]  #: radius of the sphere
    mass: Annotated[Mass, POSITIVE]  #: mass of all that moves, sphere and holder


class Drops(Table, frozen=True, kw_only=True):
    """Repeated drops of one material from one height.

    ``material`` is the name that is shown. The solid is that of ``material_from``, a DMA
    experiment of this session, or else the library's of that name, at ``temperature``. Drops of a
    material without either are measured but give no modal mass, which needs the momentum of a
    simulated impact.
    """

    material: Annotated[str, msgspec.Meta(min_length=1, max_length=60)]  #: in the library, or with material_from any
    material_from: ExperimentName | None = None  #: DMA experiment of this session
    temperature: Temperature | None = None  #: temperature of the sphere
    height: Annotated[Length, POSITIVE]  #: fall from release to first touch
    laser: Annotated[list[File], msgspec.Meta(min_length=1)]  #: recordings, one for each repeat

    @property
    def choice(self) -> MaterialChoice:
        """Where the solid comes from."""
        if self.material_from is not None:
            return MaterialChoice(material_from=self.material_from, temperature=self.temperature)
        return MaterialChoice(material=self.material, temperature=self.temperature)


class PlateVibration(OfLaser, frozen=True, kw_only=True):
    """Drops of one or more materials from one or more heights, the laser on the plate.

    Without ``sphere`` the ringing is measured but the plate's modal mass is not; ``plate_from`` of
    a drop needs it. ``sensor`` counts as for a ball drop: direction 1 when the reading grows as the plate moves up.
    """

    kind: Literal["plate_vibration"]
    drops: Annotated[list[Drops], msgspec.Meta(min_length=1)]  #: materials and heights
    sphere: FallingBody | None = None  #: the falling body, for the plate's modal mass
    counter_body: Flat = "sapphire"  #: the flat on the plate
    model: DropModel = DropModel()  #: the simulation

    def __post_init__(self) -> None:
        """Refuse a recording that is listed twice."""
        names = [name for drops in self.drops for name in drops.laser]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"listed in more than one of the drops: {', '.join(twice)}; remove one")
