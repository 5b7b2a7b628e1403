"""The kind ``contact_area``: its settings, stages and results."""

from pipelines.experiments._kind import KeyNumber, Kind, Picture, derived, judged, proposal, reported, solid_of, stage
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.schemas import DROP

_OF_FILM = "frame_rate channel exclude"
_STAGES = (
    stage(
        "contact_area.measured:radius",
        "file:film file:camera",
        f"view measured_on sphere.radius wavelength exposure region {_OF_FILM}",
        "fit the fringes around the contact",
        shortcuts=True,
        imports="labpipe.imaging.fringes._film labpipe.compilation",
    ),
    stage(
        "contact_area.measured:impacts", "radius", "", "find the largest radius of each impact, and the radius at rest"
    ),
    stage(
        "contact_area.model:model",
        f"radius impacts {solid_of('sphere')} other:plate_from/plate",
        "height sphere counter_body model plate work_of_adhesion wavelength",
        "simulate the drop",
        schema="drop",
        shortcuts=True,
        imports="labpipe.contact.impact._drop labpipe.compilation",
    ),
    stage(
        "contact_area.comparison:comparison",
        "radius impacts model",
        "sphere.radius wavelength",
        "measurement against model",
    ),
    judged(
        "contact_area",
        f"radius impacts model comparison {solid_of('sphere')} other:plate_from/plate",
        rests_on="sphere.material_from plate_from",
    ),
    stage(
        "contact_area.measured:keys", "file:film radius impacts", _OF_FILM, "key frames of the page", may_lack="impacts"
    ),
    reported("contact_area", "radius impacts model comparison keys"),
)

KIND = Kind(
    name="contact_area",
    title="Contact area",
    summary="a film of the contact through the transparent disc",
    settings=ContactArea,
    stages=_STAGES,
    schemas=(DROP,),
    key_numbers=(
        KeyNumber("largest contact radius", "m", "impacts", "peak_radius"),
        KeyNumber("largest contact radius", "m", "comparison", "peak_radius_film"),  # where there is a model
    ),
    picture=Picture("radius", "time", "radius", is_first=True),
    rows=derived("contact_area.comparison:rows", "comparison model"),
    budget=derived("contact_area.budget:quantities", "impacts radius model comparison"),
    film="pipelines.experiments.contact_area.page:film",
    body="sphere",
    evidence=derived("contact_area.evidence:evidence", f"radius impacts other:plate_from/plate {solid_of('sphere')}"),
    proposal=proposal("film", "contact_area.proposal:proposed"),
)
