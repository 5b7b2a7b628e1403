"""The verbs on a session folder, the same for all kinds of experiment.

Every command has one of these as its twin in Python; each returns objects to look at. They are
imported when they are first used, so that a plan loads nothing that it does not need.

Unless their own texts say more, they raise UsageError for a name that there is not, SourceError or ConfigError for a
session that cannot be opened, and InputError for results that are not there or not up to date.
"""

from typing import TYPE_CHECKING

from labpipe.installation import lazily

if TYPE_CHECKING:
    from pipelines.session._catalogue import catalogue as catalogue
    from pipelines.session._comparison import beside as beside, comparison_text as comparison_text
    from pipelines.session._doctor import doctor as doctor
    from pipelines.session._export import FORMATS as FORMATS, export as export
    from pipelines.session._gaps import (
        Gap as Gap,
        checked as checked,
        gap_for as gap_for,
        in_unit as in_unit,
        library_names as library_names,
        template_of as template_of,
    )
    from pipelines.session._inspection import describe as describe, inspect as inspect, write_sheet as write_sheet
    from pipelines.session._notes import note as note, with_note as with_note
    from pipelines.session._open_session import open_lab_session as open_lab_session
    from pipelines.session._overview import PAGE as PAGE, write_overview as write_overview
    from pipelines.session._processing import (
        compare as compare,
        plan as plan,
        process as process,
        process_all as process_all,
        processed_for as processed_for,
        report as report,
        verdict as verdict,
        watch as watch,
        work_folder as work_folder,
    )
    from pipelines.session._proposal import draft as draft, init as init
    from pipelines.session._publication import bundle as bundle, cite as cite, publish as publish, verify as verify
    from pipelines.session._recognition import (
        COLUMNS as COLUMNS,
        Surveyed as Surveyed,
        remedy as remedy,
        survey as survey,
    )
    from pipelines.session._results import (
        SCHEMAS as SCHEMAS,
        SETTINGS as SETTINGS,
        STAGES as STAGES,
        derive as derive,
        load as load,
        needed as needed,
        open_session as open_session,
        opened as opened,
        reopen_session as reopen_session,
        result as result,
        results as results,
    )
    from pipelines.session._sensitivity import sensitivity as sensitivity
    from pipelines.session._session_checks import stated_as_exact as stated_as_exact
    from pipelines.session._trend import trend as trend
    from pipelines.session._verdicts import (
        Verdict as Verdict,
        Verdicts as Verdicts,
        verdict_on as verdict_on,
        verdicts_of as verdicts_of,
    )
else:
    __getattr__ = lazily(__name__)
