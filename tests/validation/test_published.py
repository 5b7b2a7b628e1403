"""The page "Evidence" holds the published cases as they come out now."""

import pytest

from tests.validation.__main__ import held
from tests.validation.cases import CASES, PublishedCase


def test_the_page_holds_a_row_for_every_case_and_no_other() -> None:
    assert [row.split("|")[1:3] for row in held().values()] == [[case.name, case.inputs] for case in CASES]


@pytest.mark.parametrize(
    "case", [pytest.param(case, id=case.values.__name__, marks=[pytest.mark.slow] * case.is_long) for case in CASES]
)
def test_the_row_of_the_page_is_up_to_date(case: PublishedCase) -> None:
    """Renewed by ``python -m tests.validation``; other libraries may move a deviation by a fifth of u."""
    if not case.is_present:
        pytest.skip(f"{case.sample} lies beside the checkout only")
    page, now = held()[case.name].split("|"), case.row(case.values()).split("|")
    assert (now[3], now[6]) == (page[3], page[6])
    assert float(now[5].split()[0]) == pytest.approx(float(page[5].split()[0]), abs=0.2)
