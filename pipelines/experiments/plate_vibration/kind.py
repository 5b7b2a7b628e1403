"""The kind ``plate_vibration``: its settings, stages and results."""

from functools import partial

from labpipe.schema import Schema, Variable
from labpipe.workflow.graph import Stage
from pipelines.experiments._kind import Derived, KeyNumber, Kind, Picture, Proposal, judged, reported
from pipelines.experiments.plate_vibration.settings import PlateVibration
from pipelines.experiments.shared.schemas import DISPLACEMENT

_RINGING = Schema(
    "ringing",
    {
        "natural_frequency": Variable((), "Hz"),
        "damping_ratio": Variable((), "1"),
        "amplitude": Variable((), "m"),
        "blow_time": Variable((), "s"),
    },
)

_PLATE = Schema(
    "plate",
    {
        "frequency": Variable((), "Hz"),
        "damping_ratio": Variable((), "1"),
        "mass": Variable((), "kg"),
        "u_mass": Variable((), "kg"),
    },
)

_each = partial(Stage, per="recording", over="drops.laser")

_STAGES = (
    _each(
        "readings",
        "pipelines.experiments.shared.laser_readings:readings",
        ("file:drops.laser",),
        ("keyence",),
        summary="read the laser export",
    ),
    _each(
        "displacement",
        "pipelines.experiments.plate_vibration.measured:displacement",
        ("readings", "file:calibration"),
        ("sensor", "measured_on"),
        schema="displacement",
        summary="correct the inclination, with uncertainty",
    ),
    _each(
        "ringing",
        "pipelines.experiments.plate_vibration.measured:ringing",
        ("displacement",),
        ("blow",),
        schema="ringing",
        summary="fit the free vibration after the first impact",
    ),
    Stage(
        "table",
        "pipelines.experiments.plate_vibration.measured:table",
        ("ringing",),
        ("drops",),
        summary="frequency, damping and amplitude by material and height",
    ),
    Stage(
        "plate",
        "pipelines.experiments.plate_vibration.model:plate",
        ("table", "other:drops.material_from/master_curve"),
        ("drops", "sphere", "model"),
        schema="plate",
        summary="find the modal mass from amplitude and momentum",
    ),
    Stage(
        "model",
        "pipelines.experiments.plate_vibration.model:model",
        ("table", "plate", "other:drops.material_from/master_curve"),
        ("drops", "sphere", "model"),
        shortcuts=True,
        imports=("labpipe.contact.impact._simulate", "labpipe.compiler"),
        summary="simulate the drops on the plate",
    ),
    Stage(
        "comparison",
        "pipelines.experiments.plate_vibration.comparison:comparison",
        ("displacement", "ringing", "table", "model"),
        summary="measurement against the fitted plate",
    ),
    judged(
        "pipelines.experiments.plate_vibration.checks:judgement",
        ("readings", "displacement", "ringing", "table", "plate", "model", "comparison"),
        rests_on=("drops.material_from",),
    ),
    reported(
        "pipelines.experiments.plate_vibration.page:page",
        ("readings", "displacement", "ringing", "table", "plate", "comparison"),
    ),
)

KIND = Kind(
    name="plate_vibration",
    title="Plate vibration",
    summary="free vibration of the plate after impacts, measured by laser",
    settings=PlateVibration,
    stages=_STAGES,
    schemas=(DISPLACEMENT, _RINGING, _PLATE),
    key_numbers=(KeyNumber("plate frequency", "Hz", "plate", "frequency"),),
    picture=Picture("displacement", "time", "displacement"),
    rows=Derived("pipelines.experiments.plate_vibration.comparison:rows", ("comparison", "table", "plate")),
    budget=Derived("pipelines.experiments.plate_vibration.budget:quantities", ("displacement", "table", "plate")),
    proposal=Proposal(
        ("displacement",),
        "pipelines.experiments.plate_vibration.proposal:proposed",
        records="pipelines.experiments.shared.record_templates:laser_records",
    ),
)
