"""The kinds of experiment: one package each, described by one object :class:`Kind`.

A room holds, as far as they apply, ``kind.py`` (the object ``KIND``), ``settings.py`` (its table of
session.toml), ``measured.py``, ``model.py`` and ``comparison.py`` (stages: pure functions
from Datasets and frozen settings to a Dataset), ``budget.py`` (uncertain inputs of the main
quantities), ``evidence.py`` (evidence on a material), ``proposal.py`` (for ``init``) and ``page.py``
(the report). Parts of several kinds are in :mod:`pipelines.experiments.shared`: the checks of four instruments, each of
which alone catches a mistake that laboratories have reported, with causes, models, and sections of pages.

``KINDS`` maps every name to its kind: ours, then those of other distributions by the entry point
group ``labpipe.kinds``; ``ADDED`` lists those, with the reason if one is left out. Both are made at the
first look, so that a stage that runs imports no other kind.
"""

from typing import TYPE_CHECKING

from labpipe.installation import lazily

if TYPE_CHECKING:
    from pipelines.experiments._kind import (
        JUDGEMENT as JUDGEMENT,
        Derived as Derived,
        Found as Found,
        KeyNumber as KeyNumber,
        Kind as Kind,
        Picture as Picture,
        Proposal as Proposal,
        Proposed as Proposed,
        function as function,
    )
    from pipelines.experiments._registry import ADDED as ADDED, KINDS as KINDS
else:
    __getattr__ = lazily(__name__)
