"""Settings of a validation of the camera: a film of a drop against the laser's drops."""

import math
from typing import Annotated, Literal

import msgspec

from labpipe.units import Quantity
from labpipe.workflow.fields import Angle, ExperimentName, Range
from pipelines.experiments.shared.settings import OfCamera, Table

Pixel = Annotated[float, Range(at_least=-1e5, at_most=1e5)]
Place = Annotated[tuple[Pixel, Pixel], msgspec.Meta(description="a place [x, y] in px")]
Polygon = Annotated[
    list[Place], msgspec.Meta(min_length=3, description="a polygon of three or more places, [[x, y], [x, y], [x, y]]")
]
Polygons = Annotated[
    list[Polygon], msgspec.Meta(min_length=1, description="a list of polygons, [[[x, y], [x, y], [x, y]]]")
]


class Tracking(Table, frozen=True, kw_only=True):
    """Which points of the film are followed, in px of its first image (x right, y down).

    ``body`` is the centre of one large square on the holder, ``body_subset`` its width: it gives
    the motion. ``line`` are the ends of a line of ``points`` small subsets, as in the thesis.
    ``regions`` are polygons within which pixels count (the holder without its surroundings),
    ``covers`` polygons within which none does (a screw, a rim); both move with the holder.
    ``obstructions`` are polygons that do not move in the picture, around an object that hides the holder (a rod,
    a scale bar). A square partly outside uses the rest of it. ``static_frames`` are those before the
    release; by default they are found.
    """

    body: Place | None = None
    body_subset: Annotated[int, Range(at_least=9, at_most=2001)] | None = None
    line: tuple[Place, Place] | None = None
    points: Annotated[int, Range(at_least=1, at_most=2000)] = 20
    subset: Annotated[int, Range(at_least=9, at_most=501)] = 31  #: width of the small subsets, px
    static_frames: Annotated[int, Range(at_least=1, at_most=100000)] | None = None
    regions: Polygons | None = None
    covers: Polygons | None = None
    obstructions: Polygons | None = None

    @property
    def masks(self) -> dict[str, Polygons]:
        """The polygons that are stated, by name."""
        stated = {"regions": self.regions, "covers": self.covers, "obstructions": self.obstructions}
        return {name: polygons for name, polygons in stated.items() if polygons}


class DicValidation(OfCamera, frozen=True, kw_only=True):
    """A film of the holder, and the ball drop whose laser saw the same motion another day.

    ``camera_tilt`` is the angle by which the camera looks up or down at the motion, whose lengths it sees shortened by
    the cosine; set up by eye it is 0 within 5°.
    """

    kind: Literal["dic_validation"]
    view: str = "front"  #: the record's view
    laser_experiment: ExperimentName | None = None  #: ball drop whose laser saw the same motion
    camera_tilt: Annotated[Angle, Range(at_least=-1.0, at_most=1.0)] = Quantity(0.0, math.radians(5.0) / 3**0.5, "rad")
    tracking: Tracking = Tracking()  #: which points are followed
