"""Text that ``init`` writes for a film."""

from pipelines.experiments._kind import Found
from pipelines.experiments.shared import proposals


def head(found: Found, film: str, kind: str, name: str) -> str:
    """Return the first lines of an experiment with a film; a person knows its view better."""
    view = proposals.view(film)
    record = proposals.record(n for n in found.of("record:camera") if view in n)
    return f"""[experiments.{name}]
kind = "{kind}"  # proposed from the file name
film = "{proposals.quoted(film)}"
camera = "{record}"  # image scale of this view, with its uncertainty
view = "{view}"  # as the record says"""
