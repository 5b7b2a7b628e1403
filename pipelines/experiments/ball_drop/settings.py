"""Settings of a ball drop: repeated drops of one sphere from one height, measured by laser."""

from typing import Annotated, ClassVar, Literal

import msgspec

from labpipe.workflow.fields import POSITIVE, ExperimentName, File, Length
from pipelines.experiments.shared.settings import DropModel, Flat, OfLaser, Plate, Sphere, Table


class Analysis(Table, frozen=True, kw_only=True):
    """How displacement becomes bounces.

    ``inclination_from_height`` fits the sensor's inclination from the known drop height; the calibration record is
    then only compared. ``contact`` is the prior knowledge of the contact's pulse when an impact is fitted: "polymer"
    for spheres that return more than half of their speed, "any" for a wider prior and wider intervals.
    """

    inclination_from_height: bool = False
    contact: Literal["polymer", "any"] = "polymer"


class BallDrop(OfLaser, frozen=True, kw_only=True):
    """One sphere, one height, one or more recordings of the laser."""

    alternatives: ClassVar = (("plate", "plate_from"),)
    kind: Literal["ball_drop"]
    laser: Annotated[list[File], msgspec.Meta(min_length=1)]  #: recordings, one for each repeat
    height: Annotated[Length, POSITIVE]  #: fall from release to first touch
    sphere: Sphere  #: the falling body
    counter_body: Flat = "sapphire"  #: the flat on which it falls
    analysis: Analysis = Analysis()  #: how displacement becomes bounces
    model: DropModel = DropModel()  #: the simulation
    plate: Plate | None = None  #: the plate under the sphere, if it vibrates
    plate_from: ExperimentName | None = None  #: plate vibration that measured the plate
