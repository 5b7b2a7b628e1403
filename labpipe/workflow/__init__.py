"""A session from its configuration to its results: graph, plan, run and store.

From the ground up: ``fields``, ``document``, ``config``, ``exclusions`` and ``session`` read and check session.toml;
``graph``, ``code``, ``store`` and ``plan`` say what is to be computed and what is there; ``provenance``, ``context``,
``engines``, ``runner``, ``results`` and ``watch`` compute it and hand it on.

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
