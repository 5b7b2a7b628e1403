"""The kinds of experiment: one package each, described by one object :class:`Kind`.

A room holds, as far as they apply, ``kind.py`` (the object ``KIND``), ``settings.py`` (its table of
session.toml), ``measured.py``, ``model.py`` and ``comparison.py`` (stages: pure functions
from Datasets and frozen settings to a Dataset), ``budget.py`` (uncertain inputs of the main
quantities), ``evidence.py`` (evidence on a material), ``proposal.py`` (for ``init``) and ``page.py``
(the report). Parts of several kinds are in :mod:`pipelines.experiments.shared`.

``KINDS`` maps every name to its kind: ours, then those of other distributions by the entry point
group ``labpipe.kinds``; ``ADDED`` lists those, with the reason if one is left out. Both are made at the
first look, so that a stage that runs imports no other kind.
"""

import importlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from labpipe.plugins import tell

if TYPE_CHECKING:
    from labpipe.plugins import Plugin
    from pipelines.experiments._kind import (
        JUDGEMENT,
        Derived,
        Found,
        KeyNumber,
        Kind,
        Picture,
        Proposal,
        Proposed,
        function,
    )

    KINDS: Mapping[str, Kind]
    ADDED: tuple[Plugin[Kind], ...]

__all__ = [
    "ADDED",
    "JUDGEMENT",
    "KINDS",
    "Derived",
    "Found",
    "KeyNumber",
    "Kind",
    "Picture",
    "Proposal",
    "Proposed",
    "function",
]


def __getattr__(name: str) -> Any:
    """Make or import a public name when it is first used."""
    if name in {"KINDS", "ADDED"}:
        found = importlib.import_module("pipelines.experiments._registry").gathered()
        globals().update(KINDS=found[0], ADDED=found[1])
        tell(found[1])
        return globals()[name]
    if name in __all__:
        return getattr(importlib.import_module("pipelines.experiments._kind"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
