"""Parts that pages of all kinds share."""

from labpipe.errors import NO_INPUT
from labpipe.workflow.context import Context, Failed
from pipelines.experiments.shared.pages import failed_notice

_CONTEXT = Context("front", "dic_validation", "", "", "", True)


def test_what_failed_is_told_and_what_follows_from_it_in_one_sentence() -> None:
    failures = (
        Failed("bounces", None, "no bounce found"),
        Failed("velocity", None, "front/bounces gave no result", reason=NO_INPUT),
        Failed("keys", None, "front/bounces gave no result", reason=NO_INPUT),
    )
    context = Context("front", "dic_validation", "", "", "", True, failures=failures)
    told = [(notice.level, notice.text) for notice in failed_notice(context)]
    assert told == [
        ("error", "bounces: no bounce found"),
        ("info", "Not made without what failed before: velocity, keys."),
    ]
    assert failed_notice(_CONTEXT) == ()
