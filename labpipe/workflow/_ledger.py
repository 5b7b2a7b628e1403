"""Work done and work skipped, summed over the results of a session.

A stage leaves counts in the attribute ``work`` of its result, as JSON text. A count whose name
begins like one that ends in ``_total`` is a part of it: ``frames_read`` of ``frames_total``.
"""

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from labpipe.errors import InputError

_TOTAL = "_total"
_CLOCK = "seconds"
"""The one count that depends on the machine; it is kept out of results, which must not."""


@dataclass(frozen=True, slots=True)
class LedgerRow:
    """One count of one stage, summed over its recordings.

    ``skipped`` is the part of the total that was not needed; None when no total is known.
    """

    experiment: str
    stage: str
    name: str
    done: float
    skipped: float | None


def counts(work: Any) -> dict[str, float | int]:
    """Read the attribute ``work`` of a result, given as JSON text or as a dictionary.

    Raises
    ------
    InputError
        It is anything but names with numbers.

    Examples
    --------
    >>> counts('{"frames_read": 10, "frames_total": 100, "seconds": 0.1}')
    {'frames_read': 10, 'frames_total': 100}
    """
    try:
        found = json.loads(work) if isinstance(work, str) else dict(work or {})
        plain = {str(name): _number(value) for name, value in found.items()}
    except (ValueError, TypeError, AttributeError):
        raise InputError(f'the attribute "work" must hold counts such as {{"frames_read": 10}}: {work!r}') from None
    return {name: value for name, value in plain.items() if name != _CLOCK}


def _number(value: Any) -> float | int:
    """Return a count as a plain number; numpy's integers become Python's."""
    if isinstance(value, bool | str) or not math.isfinite(value):
        raise ValueError("not a finite number")
    return int(value) if float(value).is_integer() else float(value)


def summarise(work: Iterable[tuple[str, str, Mapping[str, float | int]]]) -> tuple[LedgerRow, ...]:
    """Sum counts into rows.

    ``work`` has (experiment, stage, counts) of each result; rows stand in the order in which experiments, stages and
    counts appear first.

    Examples
    --------
    >>> summarise([("a", "dic", {"frames_read": 10, "frames_total": 100})])
    (LedgerRow(experiment='a', stage='dic', name='frames_read', done=10, skipped=90),)
    """
    sums: dict[tuple[str, str], dict[str, float | int]] = {}
    for experiment, stage, found in work:
        target = sums.setdefault((experiment, stage), {})
        for name, value in found.items():
            target[name] = target.get(name, 0) + value
    rows = []
    for (experiment, stage), found in sums.items():
        for name, done in found.items():
            if name.endswith(_TOTAL):
                continue
            # the total that a count is a part of: the longest one whose name it begins with
            bases = [n.removesuffix(_TOTAL) for n in found if n.endswith(_TOTAL)]
            fitting = [base for base in bases if name == base or name.startswith(base + "_")]
            total = found[max(fitting, key=len) + _TOTAL] if fitting else None
            rows.append(LedgerRow(experiment, stage, name, done, None if total is None else total - done))
    return tuple(rows)
