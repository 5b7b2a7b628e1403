"""Refer free shifts to the reference temperature instead of a measured isotherm.

Free shifts are fitted relative to one isotherm. The reference temperature usually lies between
two: there log10 a is the WLF law through all shifts plus the interpolated deviation from it,
which follows a smooth law exactly and a kink closely.
"""

from dataclasses import dataclass, replace

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials._shift_law import ShiftLaw, fit_law
from labpipe.materials.spectrum import TERMS_PER_DECADE
from labpipe.materials.superposition._joint_fit import Points
from labpipe.materials.superposition._reweighting import Superposition
from labpipe.materials.superposition._shift_parameters import LEAST_SPACING
from labpipe.uncertainty import propagated_covariance

# Weight of every shift in the law that carries the interpolation (decades, equal for all).
_EQUAL = 0.05
# A gap of g decades between two sweeps is bridged by the smoothness of the spectrum. On known
# materials the step was then wrong by about this times g² decades (0.03 at 0.65, 0.11 at 1.5).
_GAP_ERROR = 0.05
# A material of few single times needs a finer grid, and its times still fall between those of the
# grid: on known materials every shift was then wrong by this share of the spacing.
_GRID_SHARE = 0.07
# Error of a sweep's temperature (K) in a furnace, and the factor by which that may be wrong; how
# many sizes of it are weighed.
_THERMOMETER, _TRIED = (0.3, 3.0), 61


@dataclass(frozen=True, slots=True)
class Anchor:
    """Where the reference lies.

    ``offset``: log10 a of the reference temperature in the frame of the fit; ``share`` (isotherm,): weights of the
    isotherms in that offset; their sum is one; ``shift_by_parameter`` (isotherm, parameter): change of the final log10
    a_T with every outer parameter; ``covariance`` (isotherm, isotherm): of the final log10 a_T; ``own`` (isotherm,):
    part of the standard uncertainty of every sweep's place on the curve that is its own, in decades; by those that the
    reference lies between, the whole curve is misplaced.
    """

    offset: float
    share: Floats
    shift_by_parameter: Floats
    covariance: Floats
    own: Floats

    @property
    def by_own(self) -> Floats:
        """Change of log10 a_T (isotherm, isotherm) with one standard uncertainty of every sweep's own."""
        return np.asarray((np.eye(self.own.size) - self.share) * self.own)


def anchor_at(points: Points, found: Superposition) -> Anchor:
    """Find log10 a at T_ref (laws are zero there by themselves), and the covariance about it."""
    model, state = found.model, found.fit.state
    count = model.temperature.size
    moves = model.directions(state)[0]
    if model.horizontal in ("wlf", "arrhenius"):
        share = np.zeros(count)
        offset = interpolation = 0.0
    else:
        share = _shares(model.temperature, model.T_ref)
        trend = _trend(model.temperature, state.log10_aT, model.T_ref)
        deviation = state.log10_aT - trend[:-1]
        offset = trend[-1] + float(share @ deviation)
        interpolation = _interpolation_error(model.temperature, deviation, model.T_ref)
        moves = moves - share @ moves
    covariance = propagated_covariance(moves, found.covariance) if model.size else np.zeros((count, count))
    if found.probe is not None:
        groups = found.probe.groups - (found.probe.groups @ share)[:, None]
        covariance = covariance + (groups.T * found.probe.variance) @ groups
    if model.horizontal == "free":
        groups, gaps = _gaps(points, model.temperature, state.log10_aT)
        groups = groups - (groups @ share)[:, None]
        covariance = covariance + (groups.T * (_GAP_ERROR * gaps**2) ** 2) @ groups
        fine = found.fit.grid.terms_per_decade
        error = _GRID_SHARE / fine if fine > TERMS_PER_DECADE else 0.0
        apart = np.eye(model.temperature.size) - share
        covariance = covariance + error**2 * (apart @ apart.T)
    if found.alternatives:
        changes = np.array([other for _, other in found.alternatives]) - state.log10_aT
        changes = changes - (changes @ share)[:, None]
        covariance = covariance + changes.T @ changes / len(found.alternatives)
    if found.slopes:
        apart = np.eye(count) - share
        covariance = covariance + propagated_covariance(apart, found.spread_of_slopes)
    if found.rival is not None:
        change = found.rival.log10_aT - state.log10_aT
        change = change - float(share @ change)
        apart = np.eye(model.temperature.size) - share
        other = np.outer(change, change) + propagated_covariance(apart, found.rival.covariance)
        covariance = covariance + found.rival.belief * other
    is_free = model.horizontal == "free"
    own = repeatability(model.temperature, state.log10_aT, covariance) if is_free else np.zeros(count)
    # An error of the interpolation moves all shifts together.
    anchor = Anchor(offset, share, moves, covariance + interpolation**2, own)
    return replace(anchor, covariance=anchor.covariance + anchor.by_own @ anchor.by_own.T)


def repeatability(temperature: Floats, log10_aT: Floats, covariance: Floats) -> Floats:
    """Return what a sweep's own error (its temperature, its specimen) adds to every shift, in decades.

    Known where a temperature was measured more than once: the shifts of repeats differ by more
    than their uncertainty says, and what they differ by nobody can exclude elsewhere. It is taken as
    an error of temperature, the larger in decades the steeper the shifts are. Few repeats leave its
    size open: :data:`_THERMOMETER` is what furnaces have, and the mean square under both counts.

    Returns
    -------
    array (isotherm,)
        Standard uncertainties, zero where no temperature was repeated.
    """
    order = np.argsort(temperature, kind="stable")
    repeated = np.flatnonzero(np.diff(temperature[order]) < LEAST_SPACING)
    if not repeated.size:
        return np.zeros(temperature.size)
    first, second = order[repeated], order[repeated + 1]
    law = _law(temperature, log10_aT, float(np.median(temperature)))
    if law is None:
        slope = np.full(temperature.size, np.ptp(log10_aT) / max(np.ptp(temperature), LEAST_SPACING))
    else:
        slope = np.abs(law.log10_aT(temperature + 0.5) - law.log10_aT(temperature - 0.5))
    expected = slope * (temperature.mean() - temperature) if law is None else law.log10_aT(temperature)
    change = (log10_aT - expected)[first] - (log10_aT - expected)[second]
    variance = np.diag(covariance)
    known = variance[first] + variance[second] - 2.0 * covariance[first, second]
    usual, factor = _THERMOMETER
    error = np.geomspace(usual / factor**3, usual * factor**3, _TRIED)
    spread = known + error[:, None] ** 2 * (slope[first] ** 2 + slope[second] ** 2)
    likelihood = -0.5 * np.sum(change**2 / spread + np.log(spread), axis=1)
    likelihood -= 0.5 * (np.log(error / usual) / np.log(factor)) ** 2
    share = np.exp(likelihood - likelihood.max())
    return np.asarray(np.sqrt(np.sum(share * error**2) / np.sum(share)) * slope)


def _gaps(points: Points, temperature: Floats, log10_aT: Floats) -> tuple[Floats, Floats]:
    """Return for every pair without overlap the colder side (one, others zero) and the gap."""
    order = np.argsort(temperature, kind="stable")
    place = np.log10(points.omega) + log10_aT[points.isotherm]
    low = np.array([place[points.isotherm == k].min() for k in order])
    high = np.array([place[points.isotherm == k].max() for k in order])
    gaps = np.maximum(low[:-1], low[1:]) - np.minimum(high[:-1], high[1:])
    groups = np.zeros((gaps.size, order.size))
    for k in range(gaps.size):
        groups[k, order[: k + 1]] = 1.0
    return groups[gaps > 0], gaps[gaps > 0]


def _shares(temperature: Floats, T_ref: float) -> Floats:
    """Linear interpolation between the two neighbours; the nearest one beyond the ends."""
    order = np.argsort(temperature, kind="stable")
    unit = np.eye(temperature.size)
    ordered = temperature[order]
    at = np.clip(T_ref, ordered[0], ordered[-1])
    shares = np.array([np.interp(at, ordered, unit[k][order]) for k in range(temperature.size)])
    return shares / shares.sum()


def _interpolation_error(temperature: Floats, deviation: Floats, T_ref: float) -> float:
    """Return the standard uncertainty of the interpolated deviation from the trend.

    Straight lines through the two isotherms on either side, continued to T_ref, differ from the
    interpolation by what a bend in between could hide.
    """
    unique, first = np.unique(temperature, return_index=True)
    values = deviation[first]
    right = int(np.searchsorted(unique, T_ref))
    if right in (0, unique.size) or unique[right] == T_ref:
        return 0.0
    inside = float(np.interp(T_ref, unique, values))
    errors = [
        inside - float(values[b] + (T_ref - unique[b]) * ((values[b] - values[a]) / (unique[b] - unique[a])))
        for a, b in ((right - 2, right - 1), (right + 1, right))
        if 0 <= a < unique.size
    ]
    return float(np.mean(np.abs(errors))) / 2.0 if errors else 0.0


def _trend(temperature: Floats, log10_aT: Floats, T_ref: float) -> Floats:
    """WLF through the shifts, at the temperatures and (last) at T_ref; zero when there is none."""
    law = _law(temperature, log10_aT, T_ref)
    return np.zeros(temperature.size + 1) if law is None else law.log10_aT(np.append(temperature, T_ref))


def _law(temperature: Floats, log10_aT: Floats, T_ref: float) -> ShiftLaw | None:
    """Fit WLF through the shifts; None where there is no such law at all temperatures."""
    if temperature.size < 4:
        return None
    law = fit_law("wlf", temperature, log10_aT, _EQUAL**2 * np.eye(temperature.size), T_ref)
    try:
        law.log10_aT(np.append(temperature - LEAST_SPACING, T_ref))
    except InputError:
        return None
    return law
