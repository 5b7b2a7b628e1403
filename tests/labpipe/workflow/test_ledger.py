"""Counts of work are paired with their totals and summed."""

import pytest

from labpipe.errors import InputError
from labpipe.workflow.context import LedgerRow, counts, summarise


def test_a_count_is_paired_with_the_total_it_belongs_to() -> None:
    work = {
        "frames_read": 10,
        "frames_total": 100,
        "bytes_read": 5,
        "steps": 7,
        "frames_dense_read": 3,
        "frames_dense_total": 4,
        "products": 2,
        "products_total": 2,
    }
    rows = {row.name: (row.done, row.skipped) for row in summarise([("a", "s", work)])}
    assert rows == {
        "frames_read": (10, 90),
        "bytes_read": (5, None),
        "steps": (7, None),
        "frames_dense_read": (3, 1),
        "products": (2, 0),
    }


def test_recordings_of_a_stage_are_summed() -> None:
    rows = summarise([("a", "s", {"steps": 1}), ("a", "s", {"steps": 2}), ("b", "s", {"steps": 4})])
    assert rows == (LedgerRow("a", "s", "steps", 3, None), LedgerRow("b", "s", "steps", 4, None))


@pytest.mark.parametrize("work", ["x", '{"a": "b"}', {"a": float("nan")}, {"a": True}])
def test_what_is_not_a_count_is_refused(work: object) -> None:
    with pytest.raises(InputError, match="must hold counts"):
        counts(work)
