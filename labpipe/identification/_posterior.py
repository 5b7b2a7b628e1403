"""The posterior: intervals, determined combinations, moduli over frequency, predictive bands.

Laplace's approximation in standard coordinates. Everything that depends on several unknowns is
carried linearly in its logarithm, consistent with the linear data: along a combination that the
data leave free, single unknowns may wander by factors while a sum of them hardly changes.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.special import ndtr, ndtri

from labpipe.arrays import Floats
from labpipe.identification._evidence import Group
from labpipe.identification._fit import Fit, laplace
from labpipe.identification._linear import modulus_basis
from labpipe.identification._problem import Misfit
from labpipe.identification._spectra import SmoothSpectrum
from labpipe.uncertainty import propagated_u
from labpipe.variables import variable

_DRAWS = 1000  # of the prior
_SEED = 20  # fixed: the same answer every time
DETERMINED = 0.5
"""A quantity is determined where the data at least halve the prior's standard deviation."""


@dataclass(frozen=True, eq=False)
class Structure:
    """One candidate for the structure of a spectrum, as the data leave it.

    ``xi`` (parameter,): Its most probable standard coordinates, nuisances last. ``covariance`` (parameter,
    parameter). ``weight``: Probability after the data.
    """

    name: str
    spectrum: SmoothSpectrum
    xi: Floats
    covariance: Floats
    weight: float


@dataclass(frozen=True, eq=False)
class Posterior:
    """Laplace's approximation around a fit.

    ``covariance`` (parameter, parameter): Of the standard coordinates; the prior's is the unit matrix.
    ``structures``: Candidates for the structure of the spectrum, where they were weighed.
    """

    fit: Fit
    covariance: Floats
    structures: tuple[Structure, ...] = ()

    @property
    def sd(self) -> Floats:
        """Standard deviations (parameter,) of the standard coordinates; 1 is the prior's."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def interval(self, number: int, level: float = 0.95) -> tuple[float, float, float]:
        """Return value, low and high end of one unknown, in its unit."""
        parameter = self.fit.problem.parameters[number]
        reach = float(ndtri(0.5 + 0.5 * level)) * float(self.sd[number])
        at = float(self.fit.xi[number])
        return parameter.value(at), parameter.value(at - reach), parameter.value(at + reach)

    def averaged(self, stated: "Stated") -> tuple[Floats, Floats]:
        """Return mean and standard deviation (n,) of quantities over all structures of the spectrum.

        ``stated``: Takes a spectrum and standard coordinates, returns quantities (n,) and derivatives (n, parameter).
        """
        own = Structure("", self.fit.problem.spectrum, self.fit.xi, self.covariance, 1.0)
        structures = self.structures or (own,)
        weights = np.array([one.weight for one in structures])
        made = [(stated(one.spectrum, one.xi), one.covariance) for one in structures]
        values = np.array([value for (value, _), _ in made])
        u = np.array([propagated_u(by_xi, covariance) for (_, by_xi), covariance in made])
        mean = weights @ values
        return mean, np.sqrt(weights @ (u**2 + (values - mean) ** 2))


Stated = Callable[[SmoothSpectrum, Floats], tuple[Floats, Floats]]


def posterior(found: Fit) -> Posterior:
    """Approximate the posterior about a fit."""
    return Posterior(found, laplace(found.jacobian)[0])


def moduli(known: Posterior, frequency: Floats) -> xr.Dataset:
    """Return storage modulus and loss factor at frequencies (n,) [Hz] with their uncertainties, before and after.

    Over ``frequency``: ``storage`` [Pa] and ``loss_factor``, most probable; ``u_ln_storage`` and ``u_ln_loss_factor``,
    standard deviations of their natural logarithms, over all structures where several were weighed;
    ``prior_ln_storage`` and ``prior_ln_loss_factor``, those of the prior; ``is_determined``, 1 where the data at least
    halve both, inside their own range. Beyond it everything is extrapolation: a spectrum that the prior holds for
    likely.
    """
    problem, omega = known.fit.problem, 2.0 * np.pi * frequency
    logarithms, u = (np.split(part, 2) for part in known.averaged(lambda of, at: ln_moduli(of, at, omega)))
    # Of the prior, half the width of the central 68 %, from draws that are the same every time.
    draws = np.random.default_rng(_SEED).standard_normal((_DRAWS, problem.n_material))
    terms = np.array([problem.spectrum.terms(one)[0] for one in draws])
    storage, loss = (terms @ basis.T for basis in modulus_basis(omega, problem.spectrum.rho))
    low, high = informative_range(known)
    made, is_determined = {}, (frequency >= low) & (frequency <= high)
    kinds = ("storage", "Pa", "storage modulus"), ("loss_factor", "1", "loss factor")
    for (name, units, text), value, sd, drawn in zip(kinds, logarithms, u, (storage, loss / storage), strict=True):
        before = 0.5 * np.diff(np.quantile(np.log(drawn), ndtr([-1.0, 1.0]), axis=0), axis=0)[0]
        is_determined &= sd < DETERMINED * before
        made[name] = variable("frequency", np.exp(value), units, text)
        made[f"u_ln_{name}"] = variable("frequency", sd, "1", "standard deviation of its logarithm")
        made[f"prior_ln_{name}"] = variable("frequency", before, "1", "the same, of the prior")
    made["is_determined"] = variable("frequency", is_determined.astype(np.int8), "1", "1 where determined")
    return xr.Dataset(made, coords={"frequency": variable("frequency", frequency, "Hz", "frequency")})


def ln_moduli(spectrum: SmoothSpectrum, xi: Floats, omega: Floats) -> tuple[Floats, Floats]:
    """Return logarithms (2 n,) of storage modulus and loss factor, and derivatives by ``xi``."""
    terms, by_xi = spectrum.terms(xi)
    bases = modulus_basis(omega, spectrum.rho)
    storage, loss = bases @ terms
    by_storage, by_loss = bases @ by_xi / np.array([storage, loss])[..., None]
    slopes = np.zeros((2 * omega.size, xi.size))
    slopes[:, : by_xi.shape[1]] = np.vstack([by_storage, by_loss - by_storage])
    return np.log(np.concatenate([storage, loss / storage])), slopes


def informative_range(known: Posterior) -> tuple[float, float]:
    """Return the lowest and highest frequency in Hz that the observations cover."""
    shortest, longest = known.fit.problem.window
    return 0.5 / np.pi / longest, 0.5 / np.pi / shortest


@dataclass(frozen=True, eq=False)
class Band:
    """One group of observations against the predictions of the identified material.

    ``evidence``: Name of the experiment. ``predicted``, ``u_predicted`` (n,): And its uncertainty by
    the unknowns. ``residual`` (n,): Observed minus predicted, over the deviation that the fit allowed.
    """

    evidence: str
    group: Group
    predicted: Floats
    u_predicted: Floats
    residual: Floats
    misfit: Misfit


def predictive_bands(known: Posterior) -> tuple[Band, ...]:
    """Return the predictions of the identified material for every group, with their bands."""
    found = known.fit
    predicted = found.corrections * found.problem.predictions(found.xi)
    u = propagated_u(found.jacobian, known.covariance)
    made = []
    for name, group, place in found.problem.groups:
        misfit = found.misfits.get((name, group.name), Misfit())
        deviation = misfit.deviation(group)
        rest = (group.values - predicted[place]) / deviation
        made.append(Band(name, group, predicted[place], u[place] * deviation, rest, misfit))
    return tuple(made)
