"""The kind ``harmonic``: its settings, stages and results."""

from pipelines.experiments._kind import KeyNumber, Kind, Picture, derived, judged, proposal, reported, solid_of, stage
from pipelines.experiments.harmonic.settings import Harmonic

_SOLID = solid_of("substrate")
_SIMULATED, _BY_THEORY = "punch substrate contact model cycles", "punch substrate characteristic_time"

_STAGES = (
    stage("shared.mach1_readings:readings", "file:mach1", "columns exclude", "read the Mach-1 file"),
    stage("shared.mach1_readings:loads", "readings file:load_cell.record", "", "tared force, with uncertainty"),
    stage("harmonic.measured:oscillations", "loads", "contact cycles", "fit stiffness, phase and work of every block"),
    stage("harmonic.measured:loops", "loads oscillations", "cycles", "mean loop per frequency; is contact lost?"),
    stage("harmonic.model:model", f"loads oscillations {_SOLID}", _SIMULATED, "simulate the measured displacement"),
    stage("harmonic.model:theory", f"oscillations loops {_SOLID}", _BY_THEORY, "work by eq. (2.31), tapping front"),
    stage("harmonic.comparison:comparison", "loads oscillations model", "", "measurement against model"),
    judged("harmonic", "readings loads oscillations model comparison", rests_on="substrate.material_from"),
    reported("harmonic", "readings loads oscillations loops model theory comparison"),
)

KIND = Kind(
    name="harmonic",
    title="Harmonic",
    summary="harmonic indentation by a periodic punch",
    settings=Harmonic,
    stages=_STAGES,
    key_numbers=(KeyNumber("storage stiffness", "N/m", "oscillations", "storage_stiffness", at="frequency"),),
    picture=Picture("loops", "position", "force"),
    rows=derived("harmonic.comparison:rows", "comparison oscillations model"),
    budget=derived("harmonic.budget:quantities", "oscillations loads"),
    body="substrate",
    evidence=derived("harmonic.evidence:evidence", f"loads oscillations {_SOLID}"),
    proposal=proposal("force", "shared.punch_proposal:oscillations"),
)
