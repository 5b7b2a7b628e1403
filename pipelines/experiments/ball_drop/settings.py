"""Settings of a ball drop: repeated drops of one sphere from one height, measured by laser."""

from datetime import date
from typing import Annotated, ClassVar, Literal

import msgspec

from labpipe.workflow.fields import POSITIVE, ExperimentName, File, Length
from pipelines.experiments.shared.settings import (
    DropModel,
    Flat,
    Keyence,
    Plate,
    Recorded,
    Sensor,
    Sphere,
    Table,
    refuse_two_plates,
)


class Analysis(Table, frozen=True, kw_only=True):
    """How displacement becomes bounces.

    ``inclination_from_height`` fits the sensor's inclination from the known drop height; the calibration record is
    then only compared. ``contact`` is the prior knowledge of the contact's pulse when an impact is fitted: "polymer"
    for spheres that return more than half of their speed, "any" for a wider prior and wider intervals.
    """

    inclination_from_height: bool = False
    contact: Literal["polymer", "any"] = "polymer"


class BallDrop(Recorded, frozen=True, kw_only=True):
    """One sphere, one height, one or more recordings of the laser.

    ``counter_body`` is the flat on which it falls.
    ``measured_on`` is the day of the measurement, for the validity of the calibration record;
    it is needed where the laser's files carry no date.
    """

    alternatives: ClassVar = (("plate", "plate_from"),)
    kind: Literal["ball_drop"]
    laser: Annotated[list[File], msgspec.Meta(min_length=1)]
    calibration: File
    height: Annotated[Length, POSITIVE]
    sphere: Sphere
    counter_body: Flat = "sapphire"
    measured_on: date | None = None
    keyence: Keyence = Keyence()
    sensor: Sensor = Sensor()
    analysis: Analysis = Analysis()
    model: DropModel = DropModel()
    plate: Plate | None = None
    plate_from: ExperimentName | None = None

    def __post_init__(self) -> None:
        """Refuse two plates."""
        refuse_two_plates(self.plate, self.plate_from)
