"""Counts of work are paired with their totals and summed."""

import pytest

from labpipe.errors import InputError
from labpipe.workflow.context import LedgerRow, counts, summarise


def test_a_count_is_paired_with_its_total_and_summed_over_recordings() -> None:
    first = {"frames_read": 10, "frames_total": 100, "bytes_read": 5, "frames_dense_read": 3, "frames_dense_total": 4}
    rows = summarise([("a", "s", first), ("a", "s", {"frames_read": 1, "steps": 2}), ("b", "s", {"steps": 4})])
    assert rows == (
        LedgerRow("a", "s", "frames_read", 11, 89),
        LedgerRow("a", "s", "bytes_read", 5, None),
        LedgerRow("a", "s", "frames_dense_read", 3, 1),
        LedgerRow("a", "s", "steps", 2, None),
        LedgerRow("b", "s", "steps", 4, None),
    )


@pytest.mark.parametrize("work", ["x", '{"a": "b"}', {"a": float("nan")}, {"a": True}])
def test_what_is_not_a_count_is_refused(work: object) -> None:
    with pytest.raises(InputError, match="must hold counts"):
        counts(work)
