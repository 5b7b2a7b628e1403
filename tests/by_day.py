"""Which cases of a long sweep run by day, with the README's command; CI runs all of them."""

from collections.abc import Iterable, Sequence
from typing import Any

import pytest


def by_day(cases: Iterable[Any], count: int) -> list[Any]:
    """Mark the cases of a sweep slow, but for so many of them, spread from the first to the last.

    A tuple is the arguments of one case, as in :func:`pytest.mark.parametrize`.
    """
    found: Sequence[Any] = list(cases)
    step = (len(found) - 1) / (count - 1) if count > 1 else 0.0
    daily = {round(step * number) for number in range(count)}
    return [
        case
        if number in daily
        else pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow)
        for number, case in enumerate(found)
    ]
