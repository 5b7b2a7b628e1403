"""The verdict on one experiment: its checks, and its comparison with the model, as one result.

A kind gathers its checks and causes (``checks.py`` of its room) and hands them over with the rows
of its comparison; here they become the stage ``judgement`` and the first section of its page.
"""

from pipelines.experiments.shared.judgements._judgement import judgement as judgement
from pipelines.experiments.shared.judgements._judging import judging as judging
from pipelines.experiments.shared.judgements._scene import Basis as Basis, Scene as Scene, measured_by as measured_by
from pipelines.experiments.shared.judgements._sentences import (
    VERDICT as VERDICT,
    noticed as noticed,
    sentence as sentence,
    verdict_blocks as verdict_blocks,
    written_place as written_place,
)
from pipelines.experiments.shared.judgements._stored import (
    believed as believed,
    compared as compared,
    suspected as suspected,
)
from pipelines.experiments.shared.judgements._titles import OF_FILM as OF_FILM, Title as Title, Titles as Titles
from pipelines.experiments.shared.judgements._usual_checks import (
    because as because,
    day_known as day_known,
    failed_steps as failed_steps,
    line_of as line_of,
    times_over as times_over,
    uncertainties_stated as uncertainties_stated,
)
from pipelines.experiments.shared.judgements._words import (
    capitalised as capitalised,
    chance as chance,
    probability as probability,
    with_minus as with_minus,
)
