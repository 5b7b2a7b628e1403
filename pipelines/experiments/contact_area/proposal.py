"""Proposals of ``init``: films named after the disc or the contact."""

from collections.abc import Iterator, Sequence
from functools import partial

from pipelines.experiments._kind import Found, Proposed
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.proposals import GAP
from pipelines.experiments.shared.record_templates import head


def proposed(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for every film from under the disc."""
    for stem, files in proposals.grouped(names, proposals.whole_stem):
        if proposals.view(files[0]) == "under":
            yield Proposed(stem, tuple(files), partial(_text, found, files[0]))


def _text(found: Found, film: str, name: str) -> str:
    return f"""{head(found, film, "contact_area", name)}
wavelength = "{GAP} nm"  # of the light; "none" for white light
{proposals.height_line(film)}

[experiments.{name}.sphere]
{proposals.SPHERE}
{proposals.MOVING_MASS}
{proposals.material_line(film, found)}"""
