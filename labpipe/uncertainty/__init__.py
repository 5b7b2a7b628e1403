"""Uncertainty budgets: linear and Monte Carlo propagation, and the share of each input.

Sources with known sensitivities make a budget directly (:class:`Source`,
:func:`combined_uncertainty`, :func:`excess_uncertainty`, :func:`scatter_beyond`, :func:`budget_rows`). A formula of
uncertain inputs is propagated linearly (:func:`linear_budget`), by Monte Carlo as a check of the
linear propagation (:func:`monte_carlo`, :func:`intervals_agree`), and by Sobol indices, which show
its largest contributions (:func:`sobol`, :func:`inputs_to_halve`). The parameters of a fit are correlated:
their covariance is propagated through derivatives (:func:`propagated_variance`,
:func:`propagated_u`, :func:`propagated_covariance`).

Arrays carry their uncertainty as a variable of their own (``u_<name>``); budgets are for the few
scalars behind them. :func:`labpipe.report.budget_table` draws them.
"""

from labpipe.uncertainty._linear import (
    Budget as Budget,
    Input as Input,
    Model as Model,
    linear_budget as linear_budget,
    propagated_covariance as propagated_covariance,
    propagated_u as propagated_u,
    propagated_variance as propagated_variance,
)
from labpipe.uncertainty._monte_carlo import (
    MonteCarlo as MonteCarlo,
    interval_difference as interval_difference,
    intervals_agree as intervals_agree,
    monte_carlo as monte_carlo,
)
from labpipe.uncertainty._sobol import Indices as Indices, inputs_to_halve as inputs_to_halve, sobol as sobol
from labpipe.uncertainty._sources import (
    Row as Row,
    Source as Source,
    budget_rows as budget_rows,
    combined_uncertainty as combined_uncertainty,
    excess_uncertainty as excess_uncertainty,
    scatter_beyond as scatter_beyond,
)
