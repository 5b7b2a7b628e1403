"""Whether a record is believable, whether the model agrees, and what that could have noticed.

A check holds two ways to the same quantity against each other, or a quantity against a law
(:func:`compared`, :func:`bounded`, :func:`stated`, :func:`not_made`); :func:`judge` makes one
verdict of all checks of a record and ranks the mistakes that would explain them
(:class:`Cause`). :func:`agreement` compares measured with predicted values, with their whole
covariance, :func:`along_curve` a whole curve in :func:`stretches` of it; :func:`detectable` says
how large an error of each input it would have shown, and :func:`suspects` and :func:`slips` which
input, stated wrongly, would explain a difference.

Nothing here knows a kind of experiment; the scheme of levels follows the flags that
oceanographers use (QARTOD: pass, not evaluated, suspect, fail). Each name is loaded when it is first
used: to tell what was found takes no SciPy.
"""

from typing import TYPE_CHECKING

from labpipe.lazy import lazily

if TYPE_CHECKING:
    from labpipe.judging._agreement import DIFFERS, LIKELY, Agreement, agreement, model_verdict
    from labpipe.judging._causes import Cause, Explanation, explain, in_words, too_large
    from labpipe.judging._checks import (
        DOUBTFUL,
        FLAGS,
        IMPOSSIBLE,
        Check,
        Finding,
        Level,
        bounded,
        compared,
        not_made,
        stated,
        unfinished,
    )
    from labpipe.judging._curves import along_curve, stretch_means, stretches
    from labpipe.judging._detectability import detectable
    from labpipe.judging._suspects import SLIPS, Factor, Slip, Suspect, best_factor, slips, suspects
    from labpipe.judging._verdict import Judgement, Verdict, from_json, judge, to_json
else:
    __getattr__ = lazily(__name__)

__all__ = [
    "DIFFERS",
    "DOUBTFUL",
    "FLAGS",
    "IMPOSSIBLE",
    "LIKELY",
    "SLIPS",
    "Agreement",
    "Cause",
    "Check",
    "Explanation",
    "Factor",
    "Finding",
    "Judgement",
    "Level",
    "Slip",
    "Suspect",
    "Verdict",
    "agreement",
    "along_curve",
    "best_factor",
    "bounded",
    "compared",
    "detectable",
    "explain",
    "from_json",
    "in_words",
    "judge",
    "model_verdict",
    "not_made",
    "slips",
    "stated",
    "stretch_means",
    "stretches",
    "suspects",
    "to_json",
    "too_large",
    "unfinished",
]
