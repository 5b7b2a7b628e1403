"""A session from its configuration to its results: graph, plan, run and store.

- :mod:`~labpipe.workflow.config`: types of configured fields, and the check against them
- :mod:`~labpipe.workflow.session`: ``session.toml``
- :mod:`~labpipe.workflow.graph`, :mod:`~labpipe.workflow.tasks`: stages, tasks and their keys
- :mod:`~labpipe.workflow.code`: the code that a stage can reach, as a part of its keys
- :mod:`~labpipe.workflow.plan`: what would run, and why
- :mod:`~labpipe.workflow.store`: results by key; :mod:`~labpipe.workflow.results`: the reader of
  those that are up to date
- :mod:`~labpipe.workflow.runner` over :mod:`~labpipe.workflow._session_run`,
  :mod:`~labpipe.workflow.engines` and :mod:`~labpipe.workflow._worker`: doing it, which
  :mod:`~labpipe.workflow.run_result` tells
- :mod:`~labpipe.workflow._log`: what the runs did, and when
- :mod:`~labpipe.workflow._ledger`, :mod:`~labpipe.workflow.provenance`,
  :mod:`~labpipe.workflow.context`: what was done, from what, and what a page is told of it

The names below are imported when they are first used, so that reading a configuration or making
a plan loads nothing that it does not need. The function ``plan`` stays in its module, whose name
it shares.
"""

from typing import TYPE_CHECKING

from labpipe.lazy import lazily

if TYPE_CHECKING:
    from labpipe.workflow._log import events as events
    from labpipe.workflow.context import Context as Context
    from labpipe.workflow.graph import Stage as Stage
    from labpipe.workflow.plan import Plan as Plan
    from labpipe.workflow.results import Results as Results, open_result as open_result
    from labpipe.workflow.run_result import RunResult as RunResult
    from labpipe.workflow.runner import run as run, run_all as run_all
    from labpipe.workflow.session import Experiment as Experiment, Session as Session, load as load
    from labpipe.workflow.store import Store as Store
else:
    __getattr__ = lazily(__name__)
