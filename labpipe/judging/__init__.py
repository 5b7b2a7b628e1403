"""Verdicts on records: believability, agreement with a model, and the errors that a comparison could have shown.

:func:`judge` makes one verdict of all checks of a record and ranks the mistakes that would explain them. Levels follow
QARTOD: pass, not evaluated, suspect, fail. :func:`agreement` compares measured with predicted values.
"""

from typing import TYPE_CHECKING

from labpipe.installation import lazily

if TYPE_CHECKING:
    from labpipe.judging._agreement import (
        DIFFERS as DIFFERS,
        LIKELY as LIKELY,
        Agreement as Agreement,
        agreement as agreement,
        along_curve as along_curve,
        detectable as detectable,
        fitted_errors as fitted_errors,
        model_verdict as model_verdict,
        stretch_means as stretch_means,
        stretches as stretches,
    )
    from labpipe.judging._cause import (
        SLIPS as SLIPS,
        Cause as Cause,
        explain as explain,
        in_words as in_words,
        too_large as too_large,
        with_causes as with_causes,
    )
    from labpipe.judging._check import (
        DOUBTFUL as DOUBTFUL,
        FLAGS as FLAGS,
        IMPOSSIBLE as IMPOSSIBLE,
        Check as Check,
        Finding as Finding,
        Level as Level,
        bounded as bounded,
        compared as compared,
        doubtful_among as doubtful_among,
        not_made as not_made,
    )
    from labpipe.judging._verdict import (
        Judgement as Judgement,
        Verdict as Verdict,
        from_json as from_json,
        judge as judge,
        to_json as to_json,
    )
else:
    __getattr__ = lazily(__name__)
