"""Hostile input to every part: right within a stated bound, or refused with a reason.

Each case is made from its seed alone, so that a failure names the seeds that show it again.
"""

import pytest

from pipelines.bench.stability import FAMILIES

CASES = [(part, name) for part, families in FAMILIES.items() for name in families]
# At most this share of a family may be refused, so that what is easy to refuse is computed too.
# Of input with a fault all may be; of the others, what no answer can be right for.
ANYTHING = {
    "invalid record",
    "agreement of invalid input",
    "no bounce",
    "invalid film",
    "invalid optics",
    "invalid material",
    "invalid sweeps",
    "invalid calibration",
    "invalid input",
}
REFUSED = dict.fromkeys(ANYTHING, 1.0) | {"any drop": 0.5, "springs and rings": 0.4}


@pytest.mark.slow
@pytest.mark.parametrize(("part", "name"), CASES)
def test_every_case_is_right_or_refused_with_a_reason(part: str, name: str) -> None:
    from pipelines.bench.stability_outcome import run_family

    case, count = FAMILIES[part][name]
    tally = run_family(case, count)
    assert tally.wrong == (), tally.worst_bound
    assert tally.right + tally.refused.total() == count
    assert tally.refused.total() <= REFUSED.get(name, 0.2) * count, tally.refused
    assert all(len(reason) > 5 for reason in tally.refused)


def test_at_least_five_thousand_cases_are_tried() -> None:
    assert sum(count for families in FAMILIES.values() for _, count in families.values()) >= 5000
