"""The reference temperature of a master curve, at which shifts are zero and vertical factors one.

A fit knows nothing of it: its laws are zero at one isotherm. The reference temperature usually lies between
two isotherms: there log10 a is on the monotone cubic through all shifts (Fritsch & Butland, SIAM J. Sci. Stat. Comput.
5 (1984) 300, doi:10.1137/0905021), and as uncertain as a value anywhere between that curve and straight lines.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials._shift_law import ShiftLaw, law_slopes
from labpipe.materials.superposition._joint_fit import Points
from labpipe.materials.superposition._model_selection import Superposition
from labpipe.materials.superposition._parameters import LEAST_SPACING
from labpipe.uncertainty import propagated_covariance

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


def reference_at(found: Superposition, T_ref: float) -> Reference:
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
        inside = np.clip(T_ref, model.temperature.min(), model.temperature.max())
        offset = float(_curve_through(model.temperature, state.log10_aT)(inside))
        interpolation = abs(offset - float(share @ state.log10_aT)) / np.sqrt(12.0)
        at_reference = share @ moves
    covariance = np.zeros((count, count))
    if model.size:
        covariance = propagated_covariance(moves - at_reference, found.covariance)
    own = np.zeros(count)
    if is_free:
        # In the frame of the fit first, so that differences of shifts know nothing of T_ref.
        own = repeatability(model.temperature, state.log10_aT, propagated_covariance(moves, found.covariance))
        covariance = covariance + propagated_covariance(np.eye(count) - share, np.diag(own**2))
    vertical = model.law_of_b(state.parameters, np.array([T_ref]))
    if vertical is None:
        raise InputError(f"T_ref = {T_ref:g} °C lies beyond the range of the vertical law; choose it among the sweeps")
    # An error of the interpolation moves all shifts together.
    return Reference(
        float(offset), float(vertical[0][0]), share, at_reference, vertical[1][0], covariance + interpolation**2, own
    )


def repeatability(temperature: Floats, log10_aT: Floats, covariance: Floats) -> Floats:
    """Return the standard uncertainty (isotherm,) of every shift by a sweep's own error, its temperature or specimen.

    Known where a temperature was measured more than once: the shifts of repeats differ by more than their uncertainty
    says, and nobody can exclude such differences elsewhere. It is taken as an error of temperature, the larger in
    decades the steeper the shifts are. Few repeats leave its size open: before the data it is that of furnaces, and the
    mean square under both counts. Zero without repeats.
    """
    order = np.argsort(temperature, kind="stable")
    repeated = np.flatnonzero(np.diff(temperature[order]) < LEAST_SPACING)
    if not repeated.size:
        return np.zeros(temperature.size)
    first, second = order[repeated], order[repeated + 1]
    curve = _curve_through(temperature, log10_aT)
    slope, rest = np.abs(curve(temperature + 0.5) - curve(temperature - 0.5)), log10_aT - curve(temperature)
    change = rest[first] - rest[second]
    known = covariance[first, first] + covariance[second, second] - 2.0 * covariance[first, second]
    error = np.geomspace(_THERMOMETER / _FACTOR**3, _THERMOMETER * _FACTOR**3, 61)
    spread = known + error[:, None] ** 2 * (slope[first] ** 2 + slope[second] ** 2)
    likelihood = -0.5 * np.sum(change**2 / spread + np.log(spread), axis=1)
    likelihood -= 0.5 * (np.log(error / _THERMOMETER) / np.log(_FACTOR)) ** 2
    share = np.exp(likelihood - likelihood.max())
    return np.asarray(np.sqrt(np.sum(share * error**2) / np.sum(share)) * slope)


def shared_decades(points: Points, log10_aT: Floats, order: NDArray[np.intp]) -> Floats:
    """Return the common decades of reduced frequency of neighbouring isotherms in an order, negative for a gap."""
    place = np.log10(points.omega) + log10_aT[points.isotherm]
    low = np.array([place[points.isotherm == k].min() for k in order])
    high = np.array([place[points.isotherm == k].max() for k in order])
    return np.asarray(np.minimum(high[:-1], high[1:]) - np.maximum(low[:-1], low[1:]))


def _curve_through(temperature: Floats, log10_aT: Floats) -> Callable[[ArrayLike], Floats]:
    """Return shifts as a function of temperature; repeats count with their mean."""
    order = np.argsort(temperature, kind="stable")
    group = np.cumsum(np.diff(temperature[order], prepend=temperature[order[0]]) >= LEAST_SPACING)
    T, shift = (np.bincount(group, values[order]) / np.bincount(group) for values in (temperature, log10_aT))
    return PchipInterpolator(T, shift) if T.size > 1 else np.poly1d(shift)
