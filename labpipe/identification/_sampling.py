r"""Independent draws from the posterior: a check of Laplace's approximation.

Randomise, then optimise: every residual row, those of the prior included, is shifted by noise of
its own, and the unknowns that answer this are a draw. With the rows :math:`R(\xi)`, their
derivative at the most probable point :math:`QT` (orthonormal :math:`Q`) and standard normal
:math:`\epsilon`, a draw solves :math:`Q^\top R(\xi) = \epsilon` and has the weight

.. math:: w = |Q^\top R'(\xi)|^{-1} \exp(-\tfrac12 |R|^2 + \tfrac12 |Q^\top R|^2)

Draws are independent, so that there is no chain that would have to converge, and equal weights say
that they follow the posterior. The surrogate of the fit (:mod:`.tangent`) stands for the models:
straight in the moduli, with the bending of the logarithms that Laplace's approximation leaves out.

References
----------
J. M. Bardsley, A. Solonen, H. Haario, M. Laine, SIAM J. Sci. Comput. 36 (2014) A1895,
doi:10.1137/140964023.
"""

from dataclasses import dataclass

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import LabpipeError
from labpipe.identification._fit import Objective
from labpipe.identification._linear import modulus_basis
from labpipe.identification._posterior import Moduli, Posterior, ln_moduli
from labpipe.identification._tangent import Surrogate

_SEED = 20  # fixed: the same draws every time
_DRAWS = 600
_MOST_STEPS = 300  # of Newton's method for a draw
_LONGEST = 1.0  # standard coordinate that one of them changes by
_FARTHEST = 12.0  # standard coordinates: beyond there is no answer
_SHORTEST = 1e-4  # part of a step that is still tried
_SOLVED = 1e-8  # of a sum of squares of standard deviations
_LEAST_SHARE = 0.3  # of effective draws from which on they may be believed


@dataclass(frozen=True, eq=False)
class Sample:
    """Independent draws of the posterior with their weights.

    ``draws`` (draw, parameter): Standard coordinates. ``weights`` (draw,): Their sum is one. ``failed``: Draws that
    have no answer.
    """

    draws: Floats
    weights: Floats
    failed: int

    @property
    def effective(self) -> float:
        """How many draws of equal weight tell as much (Kish)."""
        return float(1.0 / np.sum(self.weights**2))

    @property
    def is_reliable(self) -> bool:
        """Whether weights are equal enough, and few draws failed."""
        asked = len(self.draws) + self.failed
        return bool(self.effective >= _LEAST_SHARE * asked)

    @property
    def statement(self) -> str:
        """Whether the draws may be believed, in a sentence."""
        asked = len(self.draws) + self.failed
        said = f"effective sample size {self.effective:.0f} of {asked} draws; {self.failed} failed"
        return said if self.is_reliable else f"use the draws with care: {said}"

    def mean_and_sd(self, values: Floats) -> tuple[Floats, Floats]:
        """Return mean and standard deviation (n,) of values (draw, n)."""
        mean = self.weights @ values
        return mean, np.sqrt(self.weights @ (values - mean) ** 2)

    def quantiles(self, values: Floats, shares: Floats) -> Floats:
        """Return quantiles (share, n) of values (draw, n)."""
        made = np.empty((shares.size, values.shape[1]))
        for i, column in enumerate(values.T):
            order = np.argsort(column, kind="stable")
            weights = self.weights[order]
            made[:, i] = np.interp(shares, np.cumsum(weights) - 0.5 * weights, column[order])
        return made


def sample(known: Posterior, draws: int = _DRAWS) -> Sample:
    """Draw from the posterior, the same draws every time.

    Parameters
    ----------
    known : Posterior
        Around the most probable answer.
    draws : int
        How many are tried.

    Returns
    -------
    Sample

    Raises
    ------
    LabpipeError
        No draw has an answer.
    """
    found = known.fit
    surrogate = Objective.of(found).surrogate(found.xi)
    base = np.linalg.qr(_rows(surrogate, found.xi)[1])[0]
    rng = np.random.default_rng(_SEED)
    made = [_answer(surrogate, base, found.xi, rng.standard_normal(found.xi.size)) for _ in range(draws)]
    kept = [one for one in made if one is not None]
    if not kept:
        raise LabpipeError("every draw of the posterior failed; use --sampler laplace")
    logarithms = np.array([weight for _, weight in kept])
    weights = np.exp(logarithms - logarithms.max())
    return Sample(np.array([xi for xi, _ in kept]), weights / weights.sum(), draws - len(kept))


def _rows(surrogate: Surrogate, xi: Floats) -> tuple[Floats, Floats]:
    """Return residuals with those of the prior, and their derivative."""
    rest, slopes = surrogate.rows(xi)
    return np.concatenate([rest, xi]), np.vstack([slopes, np.eye(xi.size)])


def _answer(surrogate: Surrogate, base: Floats, start: Floats, noise: Floats) -> tuple[Floats, float] | None:
    """Return the draw of some noise and the logarithm of its weight; None where there is none."""
    xi = start
    rows, slopes = _rows(surrogate, xi)
    missing = noise - base.T @ rows
    for _ in range(_MOST_STEPS):
        height = float(missing @ missing)
        if height < _SOLVED:
            sign, logarithm = np.linalg.slogdet(base.T @ slopes)
            weight = 0.5 * float((noise - missing) @ (noise - missing) - rows @ rows)
            return (xi, weight - float(logarithm)) if sign else None
        step = np.linalg.lstsq(base.T @ slopes, missing, rcond=None)[0]
        part = min(1.0, _LONGEST / float(np.abs(step).max()))
        while part > _SHORTEST:
            trial = xi + part * step
            if np.abs(trial).max() < _FARTHEST:
                rows, slopes = _rows(surrogate, trial)
                left = noise - base.T @ rows
                if float(left @ left) < height:
                    break
            part *= 0.4
        else:
            return None
        xi, missing = trial, left
    return None


def sampled_moduli(drawn: Sample, known: Posterior, curve: Moduli) -> tuple[Floats, Floats]:
    """Return storage modulus [Pa] and loss factor (draw, frequency) of every draw.

    Draws follow the most probable structure of the spectrum; what the others say is added as
    their mean and a normal spread.

    ``known``: From which it was drawn. ``curve``: Of the same posterior.
    """
    spectrum, n = known.fit.problem.spectrum, known.fit.problem.n_material
    omega = 2.0 * np.pi * curve.frequency
    terms = np.exp([spectrum.log_terms(xi[:n]) for xi in drawn.draws])
    bases = modulus_basis(omega, spectrum.rho)
    storage, loss = (terms @ part.T for part in bases)
    own, _ = ln_moduli(spectrum, known.fit.xi, omega)
    told = np.log(np.concatenate([curve.storage, curve.loss_factor]))
    added = np.concatenate([curve.structure_ln_storage, curve.structure_ln_loss_factor])
    noise = np.random.default_rng(_SEED + 1).standard_normal((len(terms), told.size))
    factors = np.exp(told - own + added * noise)
    half = omega.size
    return storage * factors[:, :half], loss / storage * factors[:, half:]
