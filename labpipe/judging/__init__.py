"""Verdicts on records: believability, agreement with a model, and the errors that a comparison could have shown.

A check compares two ways to the same quantity, or a quantity with a law
(:func:`compared`, :func:`bounded`, :func:`stated`, :func:`not_made`); :func:`judge` makes one
verdict of all checks of a record and ranks the mistakes that would explain them
(:class:`Cause`). :func:`agreement` compares measured with predicted values, with their whole
covariance, :func:`along_curve` a whole curve in :func:`stretches` of it; :func:`detectable` says
how large an error of each input it would have shown, and :func:`suspects` which input, stated wrongly, would explain
a difference.

Nothing here knows a kind of experiment; the scheme of levels follows the flags that
oceanographers use (QARTOD: pass, not evaluated, suspect, fail). Each name is loaded when it is first
used: reading a stored verdict takes no SciPy.
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
        model_verdict as model_verdict,
        stretch_means as stretch_means,
        stretches as stretches,
        suspects as suspects,
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
