"""The kind ``ball_drop``: its settings, stages and results."""

from functools import partial

from labpipe.schema import Schema, Variable
from pipelines.experiments._kind import KeyNumber, Kind, Picture, derived, judged, proposal, reported, solid_of, stage
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared.schemas import BOUNCES, DISPLACEMENT, DROP, VELOCITY

_REPEATS = Schema(
    "repeats",
    {
        "displacement": Variable(("repeat", "time"), "m"),
        "displacement_mean": Variable(("time",), "m"),
        "displacement_sd": Variable(("time",), "m"),
        "velocity": Variable(("repeat", "time"), "m/s"),
    },
)

_each = partial(stage, per="recording", over="laser")

_STAGES = (
    _each("shared.laser_readings:readings", "file:laser", "keyence exclude", "read the laser export"),
    _each(
        "ball_drop.measured:displacement",
        "readings file:calibration",
        "sensor measured_on analysis.inclination_from_height analysis.contact height",
        "correct the inclination, with uncertainty",
        schema="displacement",
    ),
    _each(
        "ball_drop.measured:bounces",
        "displacement other:plate_from/plate",
        "analysis.contact plate sphere.mass",
        "find release, contacts, bounces and rest",
        may_lack="other:plate_from/plate",
        schema="bounces",
    ),
    _each(
        "ball_drop.measured:velocity", "displacement bounces", "", "differentiate, keeping impacts", schema="velocity"
    ),
    stage(
        "ball_drop.measured:repeats", "displacement velocity bounces", "", "mean, band and outliers", schema="repeats"
    ),
    stage(
        "ball_drop.model:model",
        f"repeats {solid_of('sphere')} other:plate_from/plate",
        "height sphere counter_body model plate",
        "simulate the drop",
        schema="drop",
        shortcuts=True,
        imports="labpipe.contact.impact._drop labpipe.compilation",
    ),
    stage(
        "ball_drop.comparison:comparison",
        "repeats model other:plate_from/plate",
        "analysis.contact plate sphere.mass model",
        "measurement against model",
        may_lack="other:plate_from/plate",
    ),
    judged(
        "ball_drop",
        f"readings displacement bounces repeats model comparison {solid_of('sphere')} other:plate_from/plate",
        rests_on="sphere.material_from plate_from",
    ),
    reported("ball_drop", "readings displacement velocity bounces repeats model comparison"),
)

KIND = Kind(
    name="ball_drop",
    title="Ball drop",
    summary="drops of a sphere, measured by laser",
    settings=BallDrop,
    stages=_STAGES,
    schemas=(BOUNCES, DISPLACEMENT, DROP, VELOCITY, _REPEATS),
    key_numbers=(KeyNumber("first restitution", "1", "repeats", "restitution"),),
    picture=Picture("repeats", "time", "displacement_mean"),
    rows=derived("ball_drop.comparison:rows", "comparison repeats model"),
    budget=derived("ball_drop.budget:quantities", "bounces displacement model"),
    body="sphere",
    evidence=derived("ball_drop.evidence:evidence", f"bounces repeats other:plate_from/plate {solid_of('sphere')}"),
    proposal=proposal("displacement", "ball_drop.proposal:proposed"),
)
