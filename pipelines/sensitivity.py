"""Which input limits each of the main reported quantities, by budgets that are checked.

The quantities are formulas of their inputs (:mod:`pipelines.experiments.budgets`), propagated
linearly, by Monte Carlo and by Sobol indices (:mod:`labpipe.uncertainty`).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labpipe.errors import InputError, UsageError
from labpipe.uncertainty import Budget, Indices, MonteCarlo, agrees, linear, monte_carlo, sobol
from labpipe.workflow.session import Experiment
from pipelines import process
from pipelines.budget_blocks import coverage_factor
from pipelines.experiments import budgets
from pipelines.experiments.budgets import Quantity
from pipelines.figures.inputs import Inputs

Read = Callable[[Inputs, Experiment], Iterator[Quantity]]


@dataclass(frozen=True, eq=False)
class Examined:
    """A quantity with its budget, checked.

    Attributes
    ----------
    experiment : str
    quantity : Quantity
    budget : Budget
        Linear.
    drawn : MonteCarlo
    is_linear : bool
        The linear 95 % interval agrees with the drawn one.
    indices : dict of str to Indices
        Sobol's.
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
    """Examine the main quantities of every experiment of a session.

    Parameters
    ----------
    folder : path-like
        The session folder; what is not processed yet is processed first.
    wanted : str, optional
        Only experiments of this kind, or of this name.

    Returns
    -------
    list of Examined

    Raises
    ------
    UsageError
        There is no such kind or experiment with budgets.
    InputError
        A step before failed.
    """
    session = process.reopen_session(folder)
    chosen = [
        e for n, e in session.experiments.items()
        if e.kind in QUANTITIES and wanted in (None, n, e.kind)
    ]  # fmt: skip
    if not chosen:
        kinds = ", ".join(QUANTITIES)
        message = (
            f'nothing to examine for "{wanted or "this session"}"; kinds with budgets: {kinds}'
        )
        raise UsageError(message)
    targets = [f"{e.name}/{s}" for e in chosen for s in QUANTITIES[e.kind][0]]
    run = process.process(folder, targets, [e.name for e in chosen])
    for outcome in run.failures:
        message = f"{outcome.task}: {outcome.message}"
        raise InputError(message)
    plan = process.plan(folder)
    inputs = Inputs(plan, {n: e.settings for n, e in plan.session.experiments.items()})
    return [
        examined(e.name, quantity) for e in chosen for quantity in QUANTITIES[e.kind][1](inputs, e)
    ]


def examined(experiment: str, quantity: Quantity) -> Examined:
    """Propagate one quantity in all three ways."""
    budget = linear(quantity.model, quantity.inputs)
    drawn = monte_carlo(quantity.model, quantity.inputs)
    return Examined(
        experiment, quantity, budget, drawn, agrees(budget, drawn),
        sobol(quantity.model, quantity.inputs),
    )  # fmt: skip


def _ball_drop(inputs: Inputs, experiment: Experiment) -> Iterator[Quantity]:
    settings: Any = experiment.settings
    made = [inputs.result(experiment.name, "bounces", f) for f in settings.laser]
    moved = inputs.result(experiment.name, "displacement", settings.laser[0])
    model = inputs.result(experiment.name, "model")
    yield from budgets.ball_drop(made, moved, model)


def _relaxation(inputs: Inputs, experiment: Experiment) -> Iterator[Quantity]:
    settings: Any = experiment.settings
    for number, file in enumerate(settings.mach1[: budgets.TESTS]):
        found = [
            inputs.result(experiment.name, stage, file) for stage in ("loads", "ramps", "curves")
        ]
        yield from budgets.relaxation(settings, number, found[0], found[1], found[2])


def _of(function: Callable[..., Iterator[Quantity]], *stages: str, with_settings: bool = False
        ) -> Read:  # fmt: skip
    """Return the way from an experiment to its quantities by the results that they need."""

    def read(inputs: Inputs, experiment: Experiment) -> Iterator[Quantity]:
        found = [inputs.result(experiment.name, stage) for stage in stages]
        settings = (experiment.settings,) if with_settings else ()
        yield from function(*settings, *found)

    return read


def _plate_vibration(inputs: Inputs, experiment: Experiment) -> Iterator[Quantity]:
    settings: Any = experiment.settings
    first = settings.drops[0].laser[0]
    moved = inputs.result(experiment.name, "displacement", first)
    found = [inputs.result(experiment.name, stage) for stage in ("table", "plate")]
    yield from budgets.plate_vibration(settings, moved, found[0], found[1])


QUANTITIES: dict[str, tuple[tuple[str, ...], Read]] = {
    "ball_drop": (("bounces", "displacement", "model"), _ball_drop),
    "contact_area": (
        ("radius", "impacts", "model"),
        _of(budgets.contact_area, "impacts", "radius", "model"),
    ),
    "relaxation": (("loads", "ramps", "curves"), _relaxation),
    "harmonic": (("loads", "oscillations"), _of(budgets.harmonic, "oscillations", "loads")),
    "static_loading": (
        ("displacement", "steps", "approach", "model"),
        _of(budgets.static_loading, "displacement", "steps", "approach", "model",
            with_settings=True),
    ),
    "plate_vibration": (("displacement", "table", "plate"), _plate_vibration),
    "dic_validation": (
        ("motion", "comparison"), _of(budgets.dic_validation, "motion", "comparison"),
    ),
    "dma": (
        ("sweeps", "master_curve", "temperature_sweep"),
        _of(budgets.dma, "sweeps", "master_curve", "temperature_sweep"),
    ),
}  # fmt: skip
"""What of each kind is read, and its main quantities."""
