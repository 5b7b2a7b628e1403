"""The verdict on one experiment: its checks, and its comparison with the model, as one result.

A kind gathers its checks and causes (``checks.py`` of its room) and hands them over with the rows
of its comparison; here they become the stage ``judgement`` and the first section of its page.
"""

from pipelines.experiments.shared.judgements._page import (
    VERDICT as VERDICT,
    believed as believed,
    capitalised as capitalised,
    chance as chance,
    compared as compared,
    noticed as noticed,
    probability as probability,
    sentence as sentence,
    suspected as suspected,
    verdict_blocks as verdict_blocks,
    with_minus as with_minus,
    written_place as written_place,
)
from pipelines.experiments.shared.judgements._scene import Basis as Basis, Scene as Scene
from pipelines.experiments.shared.judgements._stage import (
    MEASURED as MEASURED,
    OF_FILM as OF_FILM,
    Title as Title,
    Titles as Titles,
    judgement as judgement,
    judging as judging,
    u_modulus as u_modulus,
)
from pipelines.experiments.shared.judgements._usual import (
    because as because,
    day_known as day_known,
    failed_steps as failed_steps,
    line_of as line_of,
    measured_by as measured_by,
    stated_wrongly as stated_wrongly,
    times_over as times_over,
    wrong_interval as wrong_interval,
    wrong_lengths as wrong_lengths,
    wrong_scale as wrong_scale,
)
