"""The kind ``relaxation``: its settings, stages and results."""

from functools import partial

from pipelines.experiments._kind import KeyNumber, Kind, Picture, derived, judged, proposal, reported, solid_of, stage
from pipelines.experiments.relaxation.settings import Relaxation

_each = partial(stage, per="recording", over="mach1")
_SOLID, _SIMULATED = solid_of("substrate"), "punch substrate model"

_STAGES = (
    _each("shared.mach1_readings:readings", "file:mach1", "columns exclude", "read the Mach-1 file"),
    _each("shared.mach1_readings:loads", "readings file:load_cell.record", "", "tared force, with uncertainty"),
    _each("relaxation.measured:ramps", "loads", "contact", "find touch, ramps and holds: peak and plateau"),
    _each("relaxation.measured:curves", f"loads ramps {_SOLID}", _SIMULATED, "relaxation curve and moduli"),
    _each("shared.punch_model:model", f"loads ramps {_SOLID}", _SIMULATED, "simulate the measured displacement"),
    _each("relaxation.comparison:comparison", "loads ramps model", "", "measurement against model: ramp, early, late"),
    stage("relaxation.measured:tests", "ramps curves comparison", "mach1", "combine the tests, average the modulus"),
    judged("relaxation", "readings loads ramps comparison", rests_on="substrate.material_from"),
    reported("relaxation", "readings loads ramps curves model comparison tests"),
)

KIND = Kind(
    name="relaxation",
    title="Relaxation",
    summary="relaxation of rubber under a periodic punch",
    settings=Relaxation,
    stages=_STAGES,
    key_numbers=(KeyNumber("plateau force", "N", "tests", "plateau_force"),),
    picture=Picture("loads", "time", "force"),
    rows=derived("relaxation.comparison:rows", "ramps comparison"),
    budget=derived("relaxation.budget:quantities", "curves"),
    body="substrate",
    evidence=derived("relaxation.evidence:evidence", f"loads ramps curves {_SOLID}"),
    proposal=proposal("force", "shared.punch_proposal:relaxations"),
)
