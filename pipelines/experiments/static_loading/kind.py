"""The kind ``static_loading``: its settings, stages and results."""

from pipelines.experiments._kind import KeyNumber, Kind, Picture, derived, judged, proposal, reported, solid_of, stage
from pipelines.experiments.static_loading.settings import StaticLoading

_MOVED, _STEPPED = "sensor measured_on loads steps.window", "loads sphere.radius steps model.gravity"
_SIMULATED, _COMPARED, _LOADED = "sphere counter_body model", "loads sphere.radius steps", "displacement steps"

_STAGES = (
    stage("static_loading.measured:readings", "file:laser", "keyence exclude", "read the laser export"),
    stage("static_loading.measured:displacement", "readings file:calibration", _MOVED, "correct the inclination"),
    stage("static_loading.measured:steps", "displacement", _STEPPED, "find load times and first touch; compliance"),
    stage("static_loading.measured:approach", _LOADED, "sphere.radius steps", "approach, radius, creep of each load"),
    stage("static_loading.model:model", f"{_LOADED} {solid_of('sphere')}", _SIMULATED, "simulate the creep"),
    stage("static_loading.comparison:comparison", f"{_LOADED} approach model", _COMPARED, "against model and Hertz"),
    judged("static_loading", "readings displacement steps approach model comparison", rests_on="sphere.material_from"),
    reported("static_loading", "readings displacement steps approach model comparison"),
)

KIND = Kind(
    name="static_loading",
    title="Static loading",
    summary="a sphere under increasing loads, measured by laser",
    settings=StaticLoading,
    stages=_STAGES,
    key_numbers=(KeyNumber("contact radius under the first load", "m", "approach", "level_contact_radius"),),
    picture=Picture("displacement", "time", "displacement"),
    rows=derived("static_loading.comparison:rows", "comparison approach"),
    budget=derived("static_loading.budget:quantities", "displacement steps approach model"),
    body="sphere",
    proposal=proposal("displacement", "static_loading.proposal:proposed"),
)
