"""Which cases of a long sweep run by day, with the README's command; CI runs the slow ones, `-m nightly` the rest."""

from collections.abc import Iterable, Sequence
from typing import Any

import pytest


def by_day(cases: Iterable[Any], count: int, slow: int | None = None) -> list[Any]:
    """Mark the cases of a sweep slow, but for so many of them, spread from the first to the last.

    With ``slow``, so many of the others are slow, spread likewise, and the rest nightly. A tuple is
    the arguments of one case, as in :func:`pytest.mark.parametrize`.
    """
    found: Sequence[Any] = list(cases)
    daily = _spread(range(len(found)), count)
    others = [number for number in range(len(found)) if number not in daily]
    evening = set(others) if slow is None else _spread(others, slow)
    return [_marked((case,), number in daily, number in evening) for number, case in enumerate(found)]


def crossed(first: Iterable[Any], second: Iterable[Any], day: int, slow: int) -> list[Any]:
    """Cross two factors, so many cases by day, so many more as slow ones, and the rest nightly.

    They are taken along the diagonals of the table: as many cases as the longer factor has values
    hold every value of both, and the next as many each beside another value of the other factor.
    """
    rows, columns = list(first), list(second)
    fewest = min(len(rows), len(columns))
    places = [(i, j) for i in range(len(rows)) for j in range(len(columns))]
    places.sort(key=lambda place: (sum(place) % fewest, place))
    return [_marked((rows[i], columns[j]), n < day, n < day + slow) for n, (i, j) in enumerate(places)]


def _spread(numbers: Sequence[int], count: int) -> set[int]:
    step = (len(numbers) - 1) / (count - 1) if count > 1 else 0.0
    return {numbers[round(step * number)] for number in range(min(count, len(numbers)))}


def _marked(parts: tuple[Any, ...], is_daily: bool, is_slow: bool) -> Any:
    case = [value for part in parts for value in (part if isinstance(part, tuple) else (part,))]
    marks = () if is_daily else pytest.mark.slow if is_slow else pytest.mark.nightly
    return pytest.param(*case, marks=marks)
