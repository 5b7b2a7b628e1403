"""Proposals of ``init``: films named after the disc or the contact."""

from pipelines.experiments._kind import Found
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.proposals import GAP
from pipelines.experiments.shared.record_templates import head


@proposals.of_groups(proposals.whole_stem, lambda _, names: [n for n in names if proposals.view(n) == "under"])
def proposed(found: Found, files: list[str], name: str) -> str:
    """Propose an experiment for every film from under the disc."""
    return f"""{head(found, files[0], "contact_area", name)}
wavelength = "{GAP} nm"  # of the light; "none" for white light
{proposals.height_line(files[0])}

[experiments.{name}.sphere]
{proposals.SPHERE}
{proposals.MOVING_MASS}
{proposals.material_line(files[0], found)}"""
