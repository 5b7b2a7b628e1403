"""What the stage of a judgement is given, by name, and the experiments that it rests on."""

from collections.abc import Sequence
from typing import Any

from labpipe.workflow.context import Context
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements._scene import Basis


def asked(
    names: Sequence[str],
    results: Sequence[Any],
    settings: Any,
    context: Context,
    *,
    rests_on: Sequence[str] = (),
    expected: Sequence[str] = ("model", "comparison"),
    **slight: str,
) -> tuple[Given, Basis]:
    """Name what a stage is given, without what was computed from an experiment that is impossible.

    Parameters
    ----------
    names : sequence of str
        Of the results, in their order.
    results : sequence
        Those, and behind them the judgements of the experiments that this one rests on.
    settings : Struct
    context : Context
    rests_on : sequence of str
        Fields that name these experiments, as the kind lists them.
    expected : sequence of str
        Names of what is no expectation where one of them is impossible.
    **slight
        See :meth:`Basis.of`.
    """
    known = dict(zip((*names, *rests_on), results, strict=False))
    basis = Basis.of(settings, {field: known.pop(field, None) for field in rests_on}, **slight)
    if not basis.is_sound:
        known |= dict.fromkeys(expected)
    return Given(**known, settings=settings, context=context), basis
