"""The kind ``dic_validation``: its settings, stages and results."""

from pipelines.experiments._kind import KeyNumber, Kind, Picture, derived, judged, proposal, reported, stage
from pipelines.experiments.dic_validation.settings import DicValidation
from pipelines.experiments.shared.schemas import BOUNCES, VELOCITY

_STAGES = (
    stage(
        "dic_validation.measured:track",
        "file:film",
        "tracking frame_rate channel exclude",
        "track the holder through the film",
        shortcuts=True,
        imports="labpipe.imaging.dic._tracker labpipe.compilation",
    ),
    stage("dic_validation.measured:motion", "track file:camera", "view measured_on camera_tilt", "pixels to metres"),
    stage(
        "dic_validation.measured:bounces", "motion", "", "find release, contacts, bounces and rest", schema="bounces"
    ),
    stage(
        "dic_validation.measured:velocity", "motion bounces", "", "differentiate, keeping impacts", schema="velocity"
    ),
    stage(
        "dic_validation.measured:keys",
        "file:film track bounces",
        "frame_rate channel exclude",
        "select key frames for the page",
        may_lack="bounces",
    ),
    stage(
        "dic_validation.comparison:comparison",
        "motion bounces other:laser_experiment/repeats",
        "",
        "film against laser",
    ),
    judged(
        "dic_validation",
        "track motion bounces comparison other:laser_experiment/repeats",
        "is it believable, does the laser agree?",
        rests_on="laser_experiment",
    ),
    reported("dic_validation", "track motion bounces velocity keys comparison other:laser_experiment/repeats"),
)

KIND = Kind(
    name="dic_validation",
    title="Camera against laser",
    summary="a film of the holder against the laser of other drops",
    settings=DicValidation,
    stages=_STAGES,
    schemas=(BOUNCES, VELOCITY),
    key_numbers=(
        KeyNumber("first restitution", "1", "bounces", "restitution"),
        KeyNumber("film minus laser", "m", "comparison", "bias", absent="not compared"),
    ),
    picture=Picture("motion", "time", "displacement"),
    rows=derived("dic_validation.comparison:rows", "comparison"),
    budget=derived("dic_validation.budget:quantities", "motion comparison"),
    film="pipelines.experiments.dic_validation.page:film",
    proposal=proposal("film", "dic_validation.proposal:proposed"),
)
