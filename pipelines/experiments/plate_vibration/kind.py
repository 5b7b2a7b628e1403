"""The kind ``plate_vibration``: its settings, stages and results."""

from functools import partial

from labpipe.schema import Schema, Variable
from pipelines.experiments._kind import KeyNumber, Kind, Picture, derived, judged, proposal, reported, stage
from pipelines.experiments.plate_vibration.settings import PlateVibration
from pipelines.experiments.shared.schemas import DISPLACEMENT

_PLATE = Schema(
    "plate",
    {
        "frequency": Variable((), "Hz"),
        "damping_ratio": Variable((), "1"),
        "mass": Variable((), "kg"),
        "u_mass": Variable((), "kg"),
    },
)

_each = partial(stage, per="recording", over="drops.laser")

_STAGES = (
    _each("shared.laser_readings:readings", "file:drops.laser", "keyence exclude", "read the laser export"),
    _each(
        "shared.laser_readings:displacement",
        "readings file:calibration",
        "sensor measured_on",
        "correct the inclination, with uncertainty",
        schema="displacement",
    ),
    _each("plate_vibration.measured:ringing", "displacement", "", "fit the free vibration after the first impact"),
    stage(
        "plate_vibration.measured:table", "ringing", "drops", "frequency, damping and amplitude by material and height"
    ),
    stage(
        "plate_vibration.model:plate",
        "table other:drops.material_from/master_curve",
        "drops sphere counter_body model",
        "find the modal mass from amplitude and momentum",
        schema="plate",
    ),
    stage(
        "plate_vibration.model:model",
        "table plate other:drops.material_from/master_curve",
        "drops sphere counter_body model",
        "simulate the drops on the plate",
        shortcuts=True,
        imports="labpipe.contact.impact._drop labpipe.compilation",
    ),
    stage("plate_vibration.comparison:comparison", "displacement ringing table model", "", "measurement against plate"),
    judged("plate_vibration", "readings displacement ringing table plate comparison", rests_on="drops.material_from"),
    reported("plate_vibration", "readings displacement ringing table plate comparison"),
)

KIND = Kind(
    name="plate_vibration",
    title="Plate vibration",
    summary="free vibration of the plate after impacts, measured by laser",
    settings=PlateVibration,
    stages=_STAGES,
    schemas=(DISPLACEMENT, _PLATE),
    key_numbers=(KeyNumber("plate frequency", "Hz", "plate", "frequency"),),
    picture=Picture("displacement", "time", "displacement"),
    rows=derived("plate_vibration.comparison:rows", "comparison table plate"),
    budget=derived("plate_vibration.budget:quantities", "displacement table plate"),
    proposal=proposal("displacement", "plate_vibration.proposal:proposed"),
)
