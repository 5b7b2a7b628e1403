"""Uncertainty budgets: linear and Monte Carlo propagation, and the share of each input.

Sources with known sensitivities make a budget directly (:class:`Source`,
:func:`combined_uncertainty`, :func:`excess_uncertainty`, :func:`scatter_beyond`, :func:`budget_rows`). A formula of
uncertain inputs is propagated linearly (:func:`linear_budget`), by Monte Carlo as a check of the
linear propagation (:func:`monte_carlo`, :func:`intervals_agree`), and by Sobol indices, which show
what limits it (:func:`sobol`, :func:`inputs_to_halve`). The parameters of a fit are correlated:
their covariance is propagated through derivatives (:func:`propagated_variance`,
:func:`propagated_u`, :func:`propagated_covariance`).

Arrays carry their uncertainty as a variable of their own (``u_<name>``); budgets are for the few
scalars behind them. :func:`labpipe.report.budget_table` draws them.
"""

from labpipe.uncertainty._linear import (
    Budget,
    Input,
    Model,
    linear_budget,
    propagated_covariance,
    propagated_u,
    propagated_variance,
)
from labpipe.uncertainty._monte_carlo import MonteCarlo, interval_difference, intervals_agree, monte_carlo
from labpipe.uncertainty._sobol import Indices, inputs_to_halve, sobol
from labpipe.uncertainty._sources import (
    Row,
    Source,
    budget_rows,
    combined_uncertainty,
    excess_uncertainty,
    scatter_beyond,
)

__all__ = [
    "Budget",
    "Indices",
    "Input",
    "Model",
    "MonteCarlo",
    "Row",
    "Source",
    "budget_rows",
    "combined_uncertainty",
    "excess_uncertainty",
    "inputs_to_halve",
    "interval_difference",
    "intervals_agree",
    "linear_budget",
    "monte_carlo",
    "propagated_covariance",
    "propagated_u",
    "propagated_variance",
    "scatter_beyond",
    "sobol",
]
