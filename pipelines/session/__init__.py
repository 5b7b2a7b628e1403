"""The verbs on a session folder; each treats all kinds of experiment alike.

What the command line does, Python does with these; each returns objects to look at. They are
imported when they are first used, so that a plan loads nothing that it does not need.
"""

from typing import TYPE_CHECKING

from labpipe.lazy import lazily

if TYPE_CHECKING:
    from pipelines.session._catalogue import FILE as CATALOGUE, Catalogued, catalogue, query
    from pipelines.session._compare import compare
    from pipelines.session._comparison import Comparison
    from pipelines.session._contact_sheet import write_sheet
    from pipelines.session._doctor import Health, doctor
    from pipelines.session._examined import Examined, examine
    from pipelines.session._export import FORMATS, Exported, export
    from pipelines.session._gaps import Gap, checked, in_unit, library_names
    from pipelines.session._inspection import Inspected, describe, inspect
    from pipelines.session._opening import SCHEMAS, SETTINGS, STAGES, open_session, reopen_session
    from pipelines.session._overview import COMPARISON_PAGE, PAGE, write_overview
    from pipelines.session._processing import plan, process, process_all, processed_for, report, verdict, watch
    from pipelines.session._proposal import Scan, init
    from pipelines.session._results import derive, needed, opened, result, results
    from pipelines.session._sensitivity import Sensitivity, sensitivity
    from pipelines.session._sensitivity_page import advice
    from pipelines.session._survey import Surveyed, survey
    from pipelines.session._template import bare_type, gap_for
    from pipelines.session._together import beside
    from pipelines.session._verdicts import Verdict, Verdicts, verdict_on, verdicts_of
else:
    __getattr__ = lazily(__name__)

__all__ = [
    "CATALOGUE",
    "COMPARISON_PAGE",
    "FORMATS",
    "PAGE",
    "SCHEMAS",
    "SETTINGS",
    "STAGES",
    "Catalogued",
    "Comparison",
    "Examined",
    "Exported",
    "Gap",
    "Health",
    "Inspected",
    "Scan",
    "Sensitivity",
    "Surveyed",
    "Verdict",
    "Verdicts",
    "advice",
    "bare_type",
    "beside",
    "catalogue",
    "checked",
    "compare",
    "derive",
    "describe",
    "doctor",
    "examine",
    "export",
    "gap_for",
    "in_unit",
    "init",
    "inspect",
    "library_names",
    "needed",
    "open_session",
    "opened",
    "plan",
    "process",
    "process_all",
    "processed_for",
    "query",
    "reopen_session",
    "report",
    "result",
    "results",
    "sensitivity",
    "survey",
    "verdict",
    "verdict_on",
    "verdicts_of",
    "watch",
    "write_overview",
    "write_sheet",
]
