"""What pages of several experiments say first."""

import pytest

from pipelines.session._verdict_notices import agreement, belief
from pipelines.session._verdicts import Verdict


def verdicts(**believable: str) -> dict[str, Verdict]:
    return {name: Verdict(name, "ball_drop", "done", word, "none") for name, word in believable.items()}


@pytest.mark.parametrize(
    ("words", "level", "sentence"),
    [
        ({"a": "yes", "b": "yes"}, "ok", "All 2 experiments are believable."),
        ({"a": "yes", "b": "unknown"}, "info", "1 of 2 experiments is believable. Not known: b."),
        (
            {"a": "doubtful", "b": "impossible", "c": "yes", "d": "impossible"},
            "error",
            "1 of 4 experiments is believable. Impossible: b, d; doubtful: a.",
        ),
    ],
)
def test_belief_counts_and_names_what_cannot_be_believed(words: dict[str, str], level: str, sentence: str) -> None:
    said = belief(verdicts(**words), words)
    assert (said.level, said.text) == (level, sentence)


def test_agreement_counts_and_names_where_the_model_does_not_agree() -> None:
    said = agreement({"a": "agrees", "b": "undecided", "c": "none", "d": "differs"})
    assert said is not None
    assert said.level == "warning"
    assert said.text == "The model agrees in 1 of 3 experiments. Differs: d; undecided: b."
