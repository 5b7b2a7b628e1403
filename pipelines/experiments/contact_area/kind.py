"""The kind ``contact_area``: its settings, stages and results."""

from labpipe.workflow.graph import Stage
from pipelines.experiments._kind import Derived, KeyNumber, Kind, Picture, Proposal, judged, reported
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.schemas import DROP

_STAGES = (
    Stage(
        "radius",
        "pipelines.experiments.contact_area.measured:radius",
        ("file:film", "file:camera"),
        ("view", "measured_on", "sphere.radius", "wavelength", "exposure", "frame_rate"),
        shortcuts=True,
        imports=("labpipe.imaging.fringes._every_frame", "labpipe.compiler"),
        summary="fit the fringes around the contact",
    ),
    Stage(
        "impacts",
        "pipelines.experiments.contact_area.measured:impacts",
        ("radius",),
        summary="find the largest radius of each impact, and the radius at rest",
    ),
    Stage(
        "model",
        "pipelines.experiments.contact_area.model:model",
        (
            "radius",
            "impacts",
            "file:sphere.material_file",
            "other:sphere.material_from/master_curve",
            "other:plate_from/plate",
        ),
        ("height", "sphere", "model", "plate", "work_of_adhesion", "wavelength"),
        schema="drop",
        shortcuts=True,
        imports=("labpipe.contact.impact._simulate", "labpipe.compiler"),
        summary="simulate the drop",
    ),
    Stage(
        "comparison",
        "pipelines.experiments.contact_area.comparison:comparison",
        ("radius", "impacts", "model"),
        summary="measurement against model",
    ),
    judged(
        "pipelines.experiments.contact_area.checks:judgement",
        ("radius", "impacts", "model", "comparison"),
        rests_on=("sphere.material_from", "plate_from"),
    ),
    Stage(
        "keys",
        "pipelines.experiments.contact_area.measured:keys",
        ("file:film", "radius", "impacts"),
        ("frame_rate",),
        summary="select key frames for the page",
    ),
    reported("pipelines.experiments.contact_area.page:page", ("radius", "impacts", "model", "comparison", "keys")),
)

KIND = Kind(
    name="contact_area",
    title="Contact area",
    summary="a film of the contact through the transparent disc",
    settings=ContactArea,
    stages=_STAGES,
    schemas=(DROP,),
    key_numbers=(KeyNumber("largest contact radius", "m", "impacts", "peak_radius"),),
    picture=Picture("radius", "time", "radius", is_first=True),
    rows=Derived("pipelines.experiments.contact_area.comparison:rows", ("comparison", "impacts", "model")),
    budget=Derived("pipelines.experiments.contact_area.budget:quantities", ("impacts", "radius", "model")),
    body="sphere",
    evidence=Derived(
        "pipelines.experiments.contact_area.evidence:evidence",
        (
            "radius",
            "impacts",
            "other:plate_from/plate",
            "file:sphere.material_file",
            "other:sphere.material_from/master_curve",
        ),
    ),
    proposal=Proposal(
        ("film",),
        "pipelines.experiments.contact_area.proposal:proposed",
        records="pipelines.experiments.shared.record_templates:camera_records",
    ),
)
