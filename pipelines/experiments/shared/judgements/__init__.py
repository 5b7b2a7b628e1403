"""The verdict on one experiment: its checks, and its comparison with the model, as one result.

A kind gathers its checks and causes (``checks.py`` of its room) and hands them over with the rows
of its comparison; here they become the stage ``judgement`` and the first section of its page.
"""

from pipelines.experiments.shared.judgements._judgement import judgement
from pipelines.experiments.shared.judgements._judging import judging
from pipelines.experiments.shared.judgements._scene import Basis, Scene, measured_by
from pipelines.experiments.shared.judgements._sentences import VERDICT, noticed, sentence, verdict_blocks
from pipelines.experiments.shared.judgements._stored import believed, compared, suspected
from pipelines.experiments.shared.judgements._usual_checks import (
    day_known,
    failed_steps,
    line_of,
    times_over,
    uncertainties_stated,
)
from pipelines.experiments.shared.judgements._words import capitalised, chance, probability, with_minus

__all__ = [
    "VERDICT",
    "Basis",
    "Scene",
    "believed",
    "capitalised",
    "chance",
    "compared",
    "day_known",
    "failed_steps",
    "judgement",
    "judging",
    "line_of",
    "measured_by",
    "noticed",
    "probability",
    "sentence",
    "suspected",
    "times_over",
    "uncertainties_stated",
    "verdict_blocks",
    "with_minus",
]
