"""Which kinds of experiment there are: ours, then those of other distributions.

Another distribution declares its kind in its ``pyproject.toml``::

    [project.entry-points."labpipe.kinds"]
    my_kind = "my_package.kind:KIND"
"""

from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import entry_points
from types import MappingProxyType

from labpipe.errors import InputError
from labpipe.plugins import Plugin, survey, tell
from labpipe.workflow.graph import ordered
from pipelines.experiments._kind import Kind
from pipelines.experiments.ball_drop.kind import KIND as BALL_DROP
from pipelines.experiments.contact_area.kind import KIND as CONTACT_AREA
from pipelines.experiments.dic_validation.kind import KIND as DIC_VALIDATION
from pipelines.experiments.dma.kind import KIND as DMA
from pipelines.experiments.harmonic.kind import KIND as HARMONIC
from pipelines.experiments.plate_vibration.kind import KIND as PLATE_VIBRATION
from pipelines.experiments.relaxation.kind import KIND as RELAXATION
from pipelines.experiments.static_loading.kind import KIND as STATIC_LOADING

OURS = (BALL_DROP, STATIC_LOADING, HARMONIC, RELAXATION, DIC_VALIDATION, CONTACT_AREA, PLATE_VIBRATION, DMA)
"""From the general to the special: ``init`` offers a file to the last kind first."""


def _gathered() -> tuple[Mapping[str, Kind], tuple[Plugin[Kind], ...]]:
    """Return all kinds by name, and those of other distributions with the reason if one is left out."""
    kinds = {kind.name: kind for kind in OURS}
    schemas = {schema.name: schema for kind in OURS for schema in kind.schemas}
    added = []
    for plugin in survey(entry_points(group="labpipe.kinds"), Kind, list(kinds)):
        if (kind := plugin.found) is None:
            added.append(plugin)
            continue
        taken = [s.name for s in kind.schemas if schemas.get(s.name, s) != s]
        named = {stage.schema for stage in kind.stages} - {None, *(s.name for s in kind.schemas)}
        problem = ""
        if taken:
            problem = f"another kind has other schemas of the names {', '.join(taken)}"
        elif named:
            problem = f"its stages name schemas that it does not bring: {', '.join(map(str, named))}"
        else:
            try:
                ordered(kind.stages, kind.settings)
            except InputError as error:
                problem = str(error)
        added.append(replace(plugin, found=None, problem=problem) if problem else plugin)
        if not problem:
            kinds[kind.name] = kind
            schemas |= {schema.name: schema for schema in kind.schemas}
    return MappingProxyType(kinds), tuple(added)


KINDS: Mapping[str, Kind]
ADDED: tuple[Plugin[Kind], ...]
KINDS, ADDED = _gathered()
tell(ADDED)
