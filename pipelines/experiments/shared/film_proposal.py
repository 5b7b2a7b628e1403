"""Proposals of ``init`` from films: through the disc, of the contact, and from the front, of the holder."""

import re
from collections.abc import Iterator, Sequence

from pipelines.experiments._kind import Found, Proposed
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.proposals import GAP
from pipelines.experiments.shared.record_templates import head, is_exported

_NAMED = re.compile(r"front|holder|drop|fall", re.IGNORECASE)


def contacts(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for every film that is named after the disc or the contact."""

    def is_under(name: str) -> bool:
        return proposals.view(name) == "under"

    yield from proposals.of_groups(found, names, proposals.whole_stem, _contact, is_under)


def holders(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for every film; for exported images only where their name says so."""

    def is_film(name: str) -> bool:
        return bool(_NAMED.search(name)) or not is_exported(found, name)

    yield from proposals.of_groups(found, names, proposals.whole_stem, _holder, is_film)


def _contact(found: Found, files: Sequence[str], name: str) -> str:
    return f"""{head(found, files[0], "contact_area", name)}
wavelength = "{GAP} nm"  # of the light; "none" for white light
{proposals.height_line(files[0])}

[experiments.{name}.sphere]
{proposals.SPHERE}
{proposals.MOVING_MASS}
{proposals.material_line(files[0], found)}"""


def _holder(found: Found, files: Sequence[str], name: str) -> str:
    why = "proposed from the file name"
    if not _NAMED.search(files[0]):
        why = 'a guess: the name tells no view; a film through the disc is of kind "contact_area"'
    return f"""{head(found, files[0], "dic_validation", name, why)}
# laser_experiment = "NAME"  # the ball drop whose laser saw the same motion
# tracking = {{ body = [x, y], body_subset = 101 }}  # px in the first image, on the holder"""
