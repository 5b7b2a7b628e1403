"""A session from its configuration to its results: graph, plan, run and store.

- :mod:`~labpipe.workflow.fields`, :mod:`~labpipe.workflow.config`, :mod:`~labpipe.workflow.document`: types of
  configured fields, and the check of a TOML file against them
- :mod:`~labpipe.workflow.exclusions`: recordings and readings that are left out, and notes
- :mod:`~labpipe.workflow.session`: ``session.toml``
- :mod:`~labpipe.workflow.graph`: stages and tasks
- :mod:`~labpipe.workflow.plan`, :mod:`~labpipe.workflow.code`: the steps of a run, with the key and the reason of
  each, and the code in the keys
- :mod:`~labpipe.workflow.store`, :mod:`~labpipe.workflow.results`: results by key, their
  reader, and the outcome of a run; the log of all runs
- :mod:`~labpipe.workflow.runner`, :mod:`~labpipe.workflow.engines`: the run, in processes or on a cluster
- :mod:`~labpipe.workflow.provenance`, :mod:`~labpipe.workflow.context`: the origin of a result, and the part of a run
  that a page receives

The names below are imported when they are first used, so that reading a configuration or making
a plan loads nothing that it does not need. The function ``plan`` stays in its module, whose name
it shares.
"""

from typing import TYPE_CHECKING

from labpipe.installation import lazily

if TYPE_CHECKING:
    from labpipe.workflow.context import Context as Context
    from labpipe.workflow.graph import Stage as Stage
    from labpipe.workflow.plan import Plan as Plan
    from labpipe.workflow.results import Results as Results, RunResult as RunResult
    from labpipe.workflow.runner import run as run, run_all as run_all
    from labpipe.workflow.session import Experiment as Experiment, Session as Session, load as load
    from labpipe.workflow.store import Store as Store, events as events
else:
    __getattr__ = lazily(__name__)
