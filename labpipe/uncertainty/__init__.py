"""Uncertainty budgets: linear and Monte Carlo propagation, and the share of each input.

Sources whose sensitivities are known make a budget directly (:class:`Source`, :func:`combined`,
:func:`beyond`, :func:`table`). A formula of uncertain inputs is propagated linearly
(:func:`linear`), by Monte Carlo, which checks the linear way (:func:`monte_carlo`,
:func:`agrees`), and by Sobol indices, which ask what limits it (:func:`sobol`, :func:`to_halve`).
Parameters of a fit hang together: their covariance goes through derivatives (:func:`variance`,
:func:`spread`, :func:`carried`).

Arrays carry their uncertainty as a variable of their own (``u_<name>``); budgets are for the few
scalars behind them. :func:`labpipe.report.budget_table` draws them.
"""

from labpipe.uncertainty._linear import Budget, Input, Model, carried, linear, spread, variance
from labpipe.uncertainty._monte_carlo import MonteCarlo, agrees, apart, monte_carlo
from labpipe.uncertainty._sobol import Indices, sobol, to_halve
from labpipe.uncertainty._sources import Row, Source, beyond, combined, table

__all__ = [
    "Budget",
    "Indices",
    "Input",
    "Model",
    "MonteCarlo",
    "Row",
    "Source",
    "agrees",
    "apart",
    "beyond",
    "carried",
    "combined",
    "linear",
    "monte_carlo",
    "sobol",
    "spread",
    "table",
    "to_halve",
    "variance",
]
