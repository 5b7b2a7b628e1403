"""Proposals of ``init``: films named after the disc or the contact."""

from collections.abc import Iterator, Sequence

from pipelines.experiments._kind import Found, Proposed
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.proposals import GAP
from pipelines.experiments.shared.record_templates import head


def proposed(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for every film from under the disc."""
    ours = [name for name in names if proposals.view(name) == "under"]
    yield from proposals.of_groups(found, ours, proposals.whole_stem, _text)


def _text(found: Found, files: Sequence[str], name: str) -> str:
    return f"""{head(found, files[0], "contact_area", name)}
wavelength = "{GAP} nm"  # of the light; "none" for white light
{proposals.height_line(files[0])}

[experiments.{name}.sphere]
{proposals.SPHERE}
{proposals.MOVING_MASS}
{proposals.material_line(files[0], found)}"""
