"""The stage of a judgement: it names what it is given, and the experiments on which all rests."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import xarray as xr

from labpipe.workflow.context import Context
from pipelines.experiments.shared.exact_values import exact_values
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements._judgement import judgement
from pipelines.experiments.shared.judgements._scene import Basis, Scene
from pipelines.experiments.shared.judgements._titles import Titles


@dataclass(frozen=True)
class Judging:
    """The judgement of a kind: called by its stage, it makes one verdict of what the steps gave.

    ``scene``: asks by name (:mod:`pipelines.experiments.shared.given`), for ``basis`` too; ``names``: of the results
    that the stage is given, in its order; ``rests_on``: fields that name experiments, as the stage lists them; their
    judgements follow the results; ``expected``: names of what is no expectation where one of these experiments is
    impossible; ``titles``: of the checks; ``slight``: see :meth:`Basis.of`.
    """

    scene: Callable[..., Scene]
    names: tuple[str, ...]
    rests_on: tuple[str, ...]
    expected: tuple[str, ...]
    titles: Titles
    slight: Mapping[str, str]

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of what the stage is given, in its order; of a judgement, that of the field."""
        return (*self.names, *self.rests_on)

    def __call__(self, *results: Any, settings: Any, context: Context) -> xr.Dataset:
        """Judge an experiment."""
        known = dict(zip(self.inputs, results, strict=False))
        named = {field: known.pop(field, None) for field in self.rests_on}
        basis = Basis.of(settings, named, **self.slight)
        if not basis.is_sound:
            known |= dict.fromkeys(self.expected)
        made = judgement(Given(**known, settings=settings, context=context, basis=basis).ask(self.scene), self.titles)
        return made.assign_attrs(exact=json.dumps(exact_values(settings)))


def judging(
    *names: str,
    rests_on: tuple[str, ...] = (),
    expected: tuple[str, ...] = ("model", "comparison"),
    titles: Titles = MappingProxyType({}),
    **slight: str,
) -> Callable[[Callable[..., Scene]], Judging]:
    """Make the stage of a function that returns the scene of an experiment, see :class:`Judging`."""
    return lambda scene: Judging(scene, names, rests_on, expected, titles, slight)
