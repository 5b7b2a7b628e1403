"""The verbs on a session folder; each treats all kinds of experiment alike.

What the command line does, Python does with these; each returns objects to look at. They are
imported when they are first used, so that a plan loads nothing that it does not need.
"""

from typing import TYPE_CHECKING

from labpipe.lazy import lazily

if TYPE_CHECKING:
    from pipelines.session._catalogue import FILE as CATALOGUE
    from pipelines.session._catalogue import Catalogued, catalogue, query
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
    from pipelines.session._processing import check_store, plan, process, process_all, report, verdict, watch
    from pipelines.session._proposal import Scan, init
    from pipelines.session._results import derive, needed, opened, result, results
    from pipelines.session._sensitivity import Sensitivity, sensitivity
    from pipelines.session._sensitivity_page import advice
    from pipelines.session._survey import Surveyed, survey
    from pipelines.session._template import bare_type, gap_for
    from pipelines.session._together import beside
    from pipelines.session._verdicts import Verdict, Verdicts, verdict_on, verdicts_of

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
    "check_store",
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

_HOMES = {
    "Verdict": "_verdicts",
    "Verdicts": "_verdicts",
    "verdict": "_processing",
    "verdict_on": "_verdicts",
    "verdicts_of": "_verdicts",
    "CATALOGUE": "_catalogue:FILE",
    "COMPARISON_PAGE": "_overview:COMPARISON_PAGE",
    "Catalogued": "_catalogue:Catalogued",
    "Comparison": "_comparison:Comparison",
    "Examined": "_examined:Examined",
    "Exported": "_export:Exported",
    "FORMATS": "_export:FORMATS",
    "Gap": "_gaps:Gap",
    "Health": "_doctor:Health",
    "Inspected": "_inspection:Inspected",
    "PAGE": "_overview:PAGE",
    "SCHEMAS": "_opening:SCHEMAS",
    "SETTINGS": "_opening:SETTINGS",
    "STAGES": "_opening:STAGES",
    "Scan": "_proposal:Scan",
    "Sensitivity": "_sensitivity:Sensitivity",
    "advice": "_sensitivity_page:advice",
    "bare_type": "_template:bare_type",
    "beside": "_together:beside",
    "gap_for": "_template:gap_for",
    "catalogue": "_catalogue:catalogue",
    "check_store": "_processing:check_store",
    "checked": "_gaps:checked",
    "compare": "_compare:compare",
    "derive": "_results:derive",
    "describe": "_inspection:describe",
    "doctor": "_doctor:doctor",
    "examine": "_examined:examine",
    "export": "_export:export",
    "init": "_proposal:init",
    "inspect": "_inspection:inspect",
    "in_unit": "_gaps:in_unit",
    "library_names": "_gaps:library_names",
    "needed": "_results:needed",
    "open_session": "_opening:open_session",
    "opened": "_results:opened",
    "plan": "_processing:plan",
    "process": "_processing:process",
    "process_all": "_processing:process_all",
    "query": "_catalogue:query",
    "reopen_session": "_opening:reopen_session",
    "report": "_processing:report",
    "result": "_results:result",
    "results": "_results:results",
    "sensitivity": "_sensitivity:sensitivity",
    "survey": "_survey:survey",
    "Surveyed": "_survey:Surveyed",
    "watch": "_processing:watch",
    "write_overview": "_overview:write_overview",
    "write_sheet": "_contact_sheet:write_sheet",
}

if not TYPE_CHECKING:
    __getattr__ = lazily(__name__, _HOMES)
