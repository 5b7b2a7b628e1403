"""The reference temperature of a master curve, at which shifts are zero and vertical factors one.

A fit knows nothing of it: its laws are zero at one isotherm. The reference temperature usually lies between
two isotherms: there log10 a is the WLF law through all shifts plus the interpolated deviation from it, which
follows a smooth law exactly and a kink closely.
"""

from dataclasses import dataclass

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials._shift_law import ShiftLaw, fit_law, law_slopes
from labpipe.materials.spectrum import TERMS_PER_DECADE
from labpipe.materials.superposition._joint_fit import Points
from labpipe.materials.superposition._model_selection import Superposition
from labpipe.materials.superposition._parameters import LEAST_SPACING
from labpipe.uncertainty import propagated_covariance

# Weight of every shift in the law that carries the interpolation (decades, equal for all).
_EQUAL = 0.05
# A gap of g decades between two sweeps is bridged by the smoothness of the spectrum. On known
# materials the step was then wrong by about this times g² decades (0.03 at 0.65, 0.11 at 1.5).
_GAP_ERROR = 0.05
# A material of few single times needs a finer grid, and its times still fall between those of the
# grid: on known materials every shift was then wrong by this share of the spacing.
_GRID_SHARE = 0.07
# Error of a sweep's temperature (K) in a furnace, and the factor by which that may be wrong.
_THERMOMETER, _FACTOR = 0.3, 3.0


@dataclass(frozen=True, slots=True)
class Reference:
    """The reference temperature in the frame of a fit.

    ``log10_aT``, ``ln_bT``: of the reference temperature in the frame of the fit; ``share`` (isotherm,): weights of the
    isotherms in that shift, of sum one; zero where a law gives it; ``shift_by_parameter``, ``vertical_by_parameter``
    (parameter,): their changes with every outer parameter; ``covariance`` (isotherm, isotherm): of the final
    log10 a_T; ``own`` (isotherm,): part of the standard uncertainty of every sweep's place on the curve that is its
    own, in decades; by those that the reference lies between, the whole curve is misplaced.
    """

    log10_aT: float
    ln_bT: float
    share: Floats
    shift_by_parameter: Floats
    vertical_by_parameter: Floats
    covariance: Floats
    own: Floats


def reference_at(points: Points, found: Superposition, T_ref: float) -> Reference:
    """Find log10 a and ln b at T_ref, and the covariance of the shifts about it.

    Raises
    ------
    InputError
        The WLF law of the fit has its pole between the isotherms and T_ref.
    """
    model, state = found.model, found.fit.state
    count, is_free = model.temperature.size, model.horizontal == "free"
    moves, interpolation = model.directions(state)[0], 0.0
    share, at_reference = np.zeros(count), np.zeros(model.size)
    if model.horizontal in ("wlf", "arrhenius"):
        parameters = state.parameters[: model.horizontal_size]
        law = ShiftLaw(model.horizontal, model.T0, tuple(parameters.tolist()), found.covariance)
        offset = float(law.log10_aT(T_ref))
        at_reference[: model.horizontal_size] = law_slopes(law.name, parameters, np.array(T_ref), model.T0)
    else:
        # Linear interpolation between the two neighbours; the nearest one beyond the ends.
        order = np.argsort(model.temperature, kind="stable")
        share = np.array([np.interp(T_ref, model.temperature[order], row[order]) for row in np.eye(count)])
        share /= share.sum()
        law_through = _law(model.temperature, state.log10_aT, model.T0, T_ref)
        trend = (
            np.zeros(count + 1) if law_through is None else law_through.log10_aT(np.append(model.temperature, T_ref))
        )
        deviation = state.log10_aT - trend[:-1]
        offset = trend[-1] + float(share @ deviation)
        interpolation = _interpolation_error(model.temperature, deviation, T_ref)
        at_reference = share @ moves
    covariance = np.zeros((count, count))
    if model.size:
        covariance = propagated_covariance(moves - at_reference, found.covariance)
    own = np.zeros(count)
    if is_free:
        # In the frame of the fit first, so that differences of shifts know nothing of T_ref.
        frame = propagated_covariance(moves, found.covariance)
        groups, gaps = _gaps(points, model.temperature, state.log10_aT)
        extra = (groups.T * (_GAP_ERROR * gaps**2) ** 2) @ groups
        if found.fit.grid.terms_per_decade > TERMS_PER_DECADE:
            extra = extra + (_GRID_SHARE / found.fit.grid.terms_per_decade) ** 2 * np.eye(count)
        own = repeatability(model.temperature, state.log10_aT, frame + extra)
        apart = np.eye(count) - share
        covariance = covariance + propagated_covariance(apart, extra + np.diag(own**2))
    vertical = model.law_of_b(state.parameters, np.array([T_ref]))
    if vertical is None:
        raise InputError(f"T_ref = {T_ref:g} °C lies beyond the range of the vertical law; choose it among the sweeps")
    # An error of the interpolation moves all shifts together.
    return Reference(
        float(offset), float(vertical[0][0]), share, at_reference, vertical[1][0], covariance + interpolation**2, own
    )


def repeatability(temperature: Floats, log10_aT: Floats, covariance: Floats) -> Floats:
    """Return the contribution of a sweep's own error (its temperature, its specimen) to every shift, in decades.

    Known where a temperature was measured more than once: the shifts of repeats differ by more
    than their uncertainty says, and nobody can exclude such differences elsewhere. It is taken as
    an error of temperature, the larger in decades the steeper the shifts are. Few repeats leave its
    size open: before the data it is that of furnaces, and the mean square under both counts.

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
    middle = float(np.median(temperature))
    law = _law(temperature, log10_aT, middle, middle)
    if law is None:
        slope = np.full(temperature.size, np.ptp(log10_aT) / max(np.ptp(temperature), LEAST_SPACING))
    else:
        slope = np.abs(law.log10_aT(temperature + 0.5) - law.log10_aT(temperature - 0.5))
    expected = slope * (temperature.mean() - temperature) if law is None else law.log10_aT(temperature)
    change = (log10_aT - expected)[first] - (log10_aT - expected)[second]
    known = covariance[first, first] + covariance[second, second] - 2.0 * covariance[first, second]
    error = np.geomspace(_THERMOMETER / _FACTOR**3, _THERMOMETER * _FACTOR**3, 61)
    spread = known + error[:, None] ** 2 * (slope[first] ** 2 + slope[second] ** 2)
    likelihood = -0.5 * np.sum(change**2 / spread + np.log(spread), axis=1)
    likelihood -= 0.5 * (np.log(error / _THERMOMETER) / np.log(_FACTOR)) ** 2
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


def _interpolation_error(temperature: Floats, deviation: Floats, T_ref: float) -> float:
    """Return the standard uncertainty of the interpolated deviation from the trend.

    Straight lines through the two isotherms on either side, continued to T_ref, differ from the
    interpolation by the size of a bend that could hide in between.
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


def _law(temperature: Floats, log10_aT: Floats, T0: float, T_ref: float) -> ShiftLaw | None:
    """Fit WLF through shifts that are zero at T0; None where there is no such law at all temperatures."""
    if temperature.size < 4:
        return None
    law = fit_law("wlf", temperature, log10_aT, _EQUAL**2 * np.eye(temperature.size), T0)
    try:
        law.log10_aT(np.append(temperature - LEAST_SPACING, T_ref))
    except InputError:
        return None
    return law
