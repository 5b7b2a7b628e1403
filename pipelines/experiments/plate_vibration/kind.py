"""The kind ``plate_vibration``: its settings, stages and results."""

from labpipe.schema import Schema, Variable
from labpipe.workflow.graph import Stage
from pipelines.experiments._kind import Derived, KeyNumber, Kind, Picture, Proposal
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

_STAGES = (
    Stage(
        "readings",
        "pipelines.experiments.plate_vibration.measured:readings",
        ("file:drops.laser",),
        ("keyence",),
        per="recording",
        over="drops.laser",
        summary="read the laser export",
    ),
    Stage(
        "displacement",
        "pipelines.experiments.plate_vibration.measured:displacement",
        ("readings", "file:calibration"),
        ("sensor", "measured_on"),
        per="recording",
        over="drops.laser",
        schema="displacement",
        summary="correct the inclination, with uncertainty",
    ),
    Stage(
        "ringing",
        "pipelines.experiments.plate_vibration.measured:ringing",
        ("displacement",),
        ("blow",),
        per="recording",
        over="drops.laser",
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
        imports=("labpipe.contact.impact._simulate",),
        summary="simulate the drops on the plate",
    ),
    Stage(
        "comparison",
        "pipelines.experiments.plate_vibration.comparison:comparison",
        ("displacement", "ringing", "table", "model"),
        summary="measurement against the fitted plate",
    ),
    Stage(
        "judgement",
        "pipelines.experiments.plate_vibration.checks:judgement",
        ("readings", "displacement", "ringing", "table", "plate", "model", "comparison"),
        ("*",),
        context=True,
        tolerant=True,
        summary="is it believable, does the model agree?",
    ),
    Stage(
        "report",
        "pipelines.experiments.plate_vibration.page:page",
        ("judgement", "readings", "displacement", "ringing", "table", "plate", "comparison"),
        ("*",),
        output="page",
        context=True,
        summary="write the page",
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
