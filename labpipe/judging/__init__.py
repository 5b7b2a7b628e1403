"""Verdicts on records: believability, agreement with a model, and the errors that a comparison could have shown.

:func:`judge` makes one verdict of all checks of a record (:func:`compared`, :func:`bounded`, :func:`stated`,
:func:`not_made`) and ranks the mistakes that would explain them (:class:`Cause`). :func:`agreement` compares measured
with predicted values, with their whole covariance, :func:`along_curve` a curve in :func:`stretches`;
:func:`detectable` and :func:`fitted_errors` give the error of each input that would have shown, and that would explain
a difference. Levels follow QARTOD: pass, not evaluated, suspect, fail. Names are loaded when first used.
The room holds the statistics of whole curves and of stated values beside those of single checks.
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
        Explanation as Explanation,
        explain as explain,
        in_words as in_words,
        too_large as too_large,
        with_causes as with_causes,
    )
    from labpipe.judging._check import (
        DOUBTFUL as DOUBTFUL,
        FLAGS as FLAGS,
        IMPOSSIBLE as IMPOSSIBLE,
        WEIGHT as WEIGHT,
        Check as Check,
        CheckSummary as CheckSummary,
        Finding as Finding,
        Level as Level,
        bounded as bounded,
        compared as compared,
        not_made as not_made,
        stated as stated,
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
