"""The verbs on a session under their short name: ``import pipelines.process``."""

from pipelines.session import (
    SETTINGS,
    STAGES,
    export,
    open_session,
    plan,
    process,
    process_all,
    reopen_session,
    report,
    result,
    results,
    stated_as_exact,
    verdict,
    verdicts_of,
    watch,
    work_folder,
)

__all__ = [
    "SETTINGS",
    "STAGES",
    "export",
    "open_session",
    "plan",
    "process",
    "process_all",
    "reopen_session",
    "report",
    "result",
    "results",
    "stated_as_exact",
    "verdict",
    "verdicts_of",
    "watch",
    "work_folder",
]
