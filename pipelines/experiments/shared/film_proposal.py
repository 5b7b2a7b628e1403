"""Text that ``init`` writes for a film."""

from pipelines.experiments._kind import Found
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.proposals import GAP
from pipelines.experiments.shared.record_templates import camera_record


def head(found: Found, film: str, kind: str, name: str, why: str = "proposed from the file name") -> str:
    """Return the first lines of an experiment with a film; a person knows its view better."""
    view = proposals.view(film)
    record = camera_record(found, film)
    rate = f'\nframe_rate = "{GAP} Hz"  # of the camera: images hold no time' * is_exported(found, film)
    return f"""[experiments.{name}]
kind = "{kind}"  # {why}
film = "{proposals.quoted(film)}"
camera = "{record}"  # image scale of this view, with its uncertainty
view = "{view}"  # as the record says{rate}"""


def is_exported(found: Found, film: str) -> bool:
    """Return whether a film was exported as images, which may be pictures of anything."""
    return film in found.of("image_stack")
