"""The kind ``ringing_bar``: all that labpipe must know of it."""

from labpipe.schema import Schema, Variable
from labpipe.workflow.graph import Stage
from pipelines.experiments import Derived, KeyNumber, Kind, Picture, Proposal
from toy_kind.settings import RingingBar

FREQUENCY = Schema("bar_frequency", {"frequency": Variable((), "Hz")})

_EACH = {"per": "recording", "over": "recordings"}
STAGES = (
    Stage("readings", "toy_kind.measured:readings", ("file:recordings",), summary="read the vibrometer", **_EACH),
    Stage(
        "frequency",
        "toy_kind.measured:frequency",
        ("readings",),
        schema="bar_frequency",
        summary="frequency by the times of its zeros",
        **_EACH,
    ),
    Stage("comparison", "toy_kind.measured:comparison", ("frequency",), ("sag", "gravity"), summary="mean against sag"),
    Stage("report", "toy_kind.page:page", ("readings", "comparison"), ("*",), output="page", context=True),
)

KIND = Kind(
    name="ringing_bar",
    title="Ringing bar",
    summary="a bar on a spring, seen by a vibrometer",
    settings=RingingBar,
    stages=STAGES,
    schemas=(FREQUENCY,),
    key_numbers=(KeyNumber("bar frequency", "Hz", "comparison", "measured"),),
    picture=Picture("readings", "time", "out1"),
    rows=Derived("toy_kind.derived:rows", ("comparison",)),
    budget=Derived("toy_kind.derived:quantities", ("comparison",)),
    proposal=Proposal(("displacement",), "toy_kind.derived:proposed"),
)
