"""Low-dimensional parametrisation of relaxation spectra.

A spectrum is a Prony series on a fixed grid of relaxation times, as the natural logarithms
of ``(E_relaxed, E_1, …, E_n)``, and their derivative by the standard coordinates.

Smooth spectrum. The logarithm of the weight per decade walks over the decades: from one decade to
the next a spectrum changes by a factor of ten within two standard deviations. Its slope turns
within two decades (an Ornstein–Uhlenbeck process), as that of Cole and Cole's dispersions does: the
slope of an order of one half turns over 4 ln-units of time. Slopes that were new at every term
would allow for kinks that no polymer has, and the loss factor at a given frequency would be as
uncertain as they are. Level and long-time modulus are known within a factor of a hundred of a
polymer's. Nothing else is assumed; where data are silent the answer is the prior.

Uneven spectrum. The same with slopes that turn within half a decade: a shoulder or a narrow peak,
as the steep ends of Havriliak and Negami's dispersions are (:mod:`._model_averaging` tests if the
data show any).

References
----------
K. S. Cole & R. H. Cole, J. Chem. Phys. 9 (1941) 341, doi:10.1063/1.1750906;
N. W. Tschoegl, The Phenomenological Theory of Linear Viscoelastic Behavior (1989), ch. 6,
doi:10.1007/978-3-642-73602-5.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import count, pairwise
from math import ceil, log, log10

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.identification._parameters import Parameter
from labpipe.materials import Prony

_POLYMER, _WIDE = log(1e8), log(100.0)  # a polymer's modulus lies between a rubber's and a glass's, within this factor

_PER_DECADE = 0.5 * log(10.0)
"""Standard deviation of the change of a spectrum from one decade to the next: in logarithmic
coordinates the flanks of spectra are seldom steeper than one to one, which makes two of them."""

_MARGIN = 10.0  # the fine grid goes a decade beyond the data
_QUICKER = 2
"""Decades below the fine grid, one term each: a spectrum that rises towards a glass transition
reaches into the data from there (its loss modulus falls only as the frequency)."""
_LEAST = 1e-9  # Pa: a term that has fallen to nothing
HORIZON = 1e9
"""s; "relaxed" is what is left after thirty years, not after a record."""


def relaxation_times(shortest: float, longest: float, per_decade: int = 2) -> Floats:
    """Choose relaxation times for data that reach from one time to another.

    ``shortest``, ``longest`` [s]: Shortest and longest time that the data cover. ``per_decade``: Through the
    data and a decade beyond them. Returns (term,) [s]: In addition one per decade: two decades more towards short
    times, and on to :data:`HORIZON`. Raises InputError: The times are not positive or not in order.
    """
    if not 0.0 < shortest <= longest < np.inf:
        raise InputError(f"data from {shortest} s to {longest} s: expected 0 < shortest <= longest")
    low, high = log10(shortest / _MARGIN), log10(longest * _MARGIN)
    fine = low + np.arange(ceil((high - low) * per_decade) + 1) / per_decade
    quick = fine[0] - np.arange(_QUICKER, 0, -1)
    slow = fine[-1] + np.arange(1, ceil(max(log10(HORIZON) - fine[-1], 0.0)) + 1)
    return np.asarray(10.0 ** np.concatenate([quick, fine, slow]))


@dataclass(frozen=True, eq=False)
class SmoothSpectrum:
    """Weights on a grid, of which the logarithm per decade is a random walk.

    ``rho`` (term,) [s]: Relaxation times, ascending; at least two. ``nu``: Poisson's ratio. ``turn``: Decades within
    which its slope forgets itself.

    Examples
    --------
    >>> spectrum = SmoothSpectrum(relaxation_times(1e-2, 1e2), nu=0.5)
    >>> len(spectrum.parameters) == len(spectrum.rho) + 1
    True
    """

    rho: Floats
    nu: float
    turn: float = 2.0

    def __post_init__(self) -> None:
        if self.rho.size < 2 or not np.all(np.diff(self.rho) > 0.0) or not self.rho[0] > 0.0:
            raise InputError("a spectrum needs at least two relaxation times, positive and ascending")

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Long-time modulus, level of the spectrum in its middle, and its changes."""
        rho, sds = self.rho.tolist(), np.diag(self._root).tolist()
        level = f"weight per decade at {rho[len(rho) // 2]:.2g} s"
        texts = [f"ln change, {a:.2g} to {b:.2g} s, independent of the previous changes" for a, b in pairwise(rho)]
        return (
            Parameter("E_relaxed", _POLYMER, _WIDE, "Pa", "long-time modulus", is_log=True),
            Parameter("level", _POLYMER - log(10.0), _WIDE, "Pa", level, is_log=True),
            *(Parameter(f"change {i}", 0.0, sd, "1", text) for i, sd, text in zip(count(1), sds, texts, strict=False)),
        )

    def terms(self, xi: Floats) -> tuple[Floats, Floats]:
        """Return (E_relaxed, E_1, ..., E_n) [Pa] at standard coordinates, nuisances last, and their derivative.

        The derivative (1 + term, parameter) is by the coordinates of the material.
        """
        at, by_xi = self._logarithms
        terms = np.exp(at + by_xi @ xi[: by_xi.shape[1]])
        return terms, terms[:, None] * by_xi

    @cached_property
    def _logarithms(self) -> tuple[Floats, Floats]:
        """Logarithms of the terms at zero (1 + term,), and their constant derivative (1 + term, parameter)."""
        n, middle = self.rho.size, self.rho.size // 2
        # From E_relaxed, level and changes to the logarithms: sums away from the middle.
        walk, change = np.zeros((n + 1, n + 1)), np.arange(n - 1)
        walk[0, 0] = walk[1:, 1] = 1.0
        walk[1:, 2:] = 1.0 * (np.arange(n)[:, None] > change) - (change < middle)
        mixed = np.diag([p.sd for p in self.parameters])
        mixed[2:, 2:] = self._root
        at = walk @ np.array([p.mean for p in self.parameters])
        at[1:] += np.log(np.gradient(np.log10(self.rho)))  # decades that belong to each term
        return at, walk @ mixed

    @cached_property
    def _root(self) -> Floats:
        """Root (change, change) of the covariance of the changes: integrals of a slope."""
        decades = np.log10(self.rho)
        lasting = np.diff(decades) / self.turn
        middle = 0.5 * (decades[1:] + decades[:-1]) / self.turn
        apart = np.exp(-np.abs(middle[:, None] - middle))
        covariance = 4.0 * np.outer(np.sinh(lasting / 2.0), np.sinh(lasting / 2.0)) * apart
        np.fill_diagonal(covariance, _variance(lasting))
        scale = _PER_DECADE / np.sqrt(_variance(np.array(1.0 / self.turn)))
        return np.asarray(scale * np.linalg.cholesky(covariance))

    def start(self, modulus: float, loss: float) -> Floats:
        """Return a flat spectrum: the weight of a decade is 1.5 times loss factor and modulus.

        A constant weight H per ln(rho) has a loss modulus of pi H/2.
        """
        flat = np.log([modulus, 2.0 / np.pi * log(10.0) * loss * modulus])
        xi = np.zeros(len(self.parameters))
        xi[:2] = [(value - p.mean) / p.sd for value, p in zip(flat, self.parameters, strict=False)]
        return xi

    def coordinates_of(self, solid: Prony) -> Floats:
        """Return coordinates of a spectrum that goes as that of another series does."""
        decades, own = (np.gradient(np.log10(rho)) for rho in (solid.rho, self.rho))
        weight = np.log(np.maximum(solid.E, _LEAST) / decades)
        terms = np.interp(np.log(self.rho), np.log(solid.rho), weight) + np.log(own)
        at, by_xi = self._logarithms
        return np.asarray(np.linalg.solve(by_xi, np.append(log(solid.E_relaxed), terms) - at))


def _variance(lasting: Floats) -> Floats:
    """Return the variance of a slope's integral over a time, both in units of its memory."""
    return np.asarray(2.0 * (lasting + np.expm1(-lasting)))
