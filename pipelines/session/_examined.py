"""The input that limits each of the main quantities, from budgets checked by Monte Carlo.

The quantities are formulas of their inputs (:attr:`pipelines.experiments.Kind.budget`), propagated
linearly, by Monte Carlo and by Sobol indices (:mod:`labpipe.uncertainty`).
"""

from dataclasses import dataclass
from pathlib import Path

from labpipe.errors import UsageError
from labpipe.uncertainty import Budget, Indices, MonteCarlo, intervals_agree, linear_budget, monte_carlo, sobol
from pipelines.experiments import KINDS
from pipelines.experiments.shared.budget_blocks import coverage_factor
from pipelines.experiments.shared.budget_quantity import Quantity
from pipelines.session._opening import reopen_session
from pipelines.session._processing import processed_for
from pipelines.session._results import derive


@dataclass(frozen=True, eq=False)
class Examined:
    """A quantity of an experiment with its budget, checked.

    ``budget`` is linear; ``is_linear`` tells that its 95 % interval agrees with that of ``drawn``; ``indices`` are
    Sobol's, by input.
    """

    experiment: str
    quantity: Quantity
    budget: Budget
    drawn: MonteCarlo
    is_linear: bool
    indices: dict[str, Indices]

    @property
    def coverage_factor(self) -> float:
        """Expanded over standard uncertainty, for 95 %."""
        return coverage_factor(self.budget)


def examine(folder: str | Path, wanted: str | None = None) -> list[Examined]:
    """Examine the main quantities of a session's experiments, all or those of one kind or name.

    What is not processed yet is processed first; it raises what :func:`pipelines.session.sensitivity` does.
    """
    session = reopen_session(folder)
    budgets = {name: kind.budget for name, kind in KINDS.items() if kind.budget is not None}
    chosen = [e for n, e in session.experiments.items() if e.kind in budgets and wanted in (None, n, e.kind)]
    if not chosen:
        kinds = ", ".join(budgets)
        raise UsageError(f'nothing to examine for "{wanted or "this session"}"; kinds with budgets: {kinds}')
    results = processed_for(folder, [(e, budgets[e.kind]) for e in chosen])
    return [examined(e.name, quantity) for e in chosen for quantity in derive(results, e, budgets[e.kind])]


def examined(experiment: str, quantity: Quantity) -> Examined:
    """Propagate one quantity in all three ways."""
    budget = linear_budget(quantity.model, quantity.inputs)
    drawn = monte_carlo(quantity.model, quantity.inputs)
    return Examined(
        experiment, quantity, budget, drawn, intervals_agree(budget, drawn), sobol(quantity.model, quantity.inputs)
    )
