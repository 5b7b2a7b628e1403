"""Settings that several kinds of experiment share, each with its unit and its reason."""

from typing import Annotated

import msgspec
from labpipe.workflow.config import Length, Mass


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of session.toml; an unknown key is a mistake, not a wish."""


class Sphere(Table):
    """The falling body.

    ``mass`` is all that moves: sphere and holder. ``material`` is a name of the library
    (``acrylic``), a TOML file of the session, or ``experiment:NAME`` for a DMA experiment.
    """

    radius: Length
    mass: Mass
    material: str


class Model(Table):
    """How the drop is simulated.

    ``profile`` is the gap's shape: the parabola of the thesis or the exact sphere (7e-4 in force
    at a contact radius of 0.8 mm). ``rtol`` bounds the error of restitution and peak force.
    """

    solver: str = "mdr"
    profile: str = "parabola"
    rtol: Annotated[float, msgspec.Meta(gt=0, le=1e-2)] = 1e-4
