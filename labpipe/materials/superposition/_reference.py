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
from labpipe.materials.superposition._model_selection import Superposition
from labpipe.materials.superposition._parameters import LEAST_SPACING
from labpipe.uncertainty import propagated_covariance

# Weight of every shift in the law that carries the interpolation (decades, equal for all).
_EQUAL = 0.05


@dataclass(frozen=True, slots=True)
class Reference:
    """The reference temperature in the frame of a fit.

    ``log10_aT``, ``ln_bT``: of the reference temperature in the frame of the fit; ``share`` (isotherm,): weights of the
    isotherms in that shift, of sum one; zero where a law gives it; ``shift_by_parameter``, ``vertical_by_parameter``
    (parameter,): their changes with every outer parameter; ``own`` (isotherm,): part of the standard uncertainty of
    every sweep's place on the curve that is its own, in decades; by those that the reference lies between, the whole
    curve is misplaced.
    """

    log10_aT: float
    ln_bT: float
    share: Floats
    shift_by_parameter: Floats
    vertical_by_parameter: Floats
    own: Floats


def reference_at(found: Superposition, T_ref: float) -> Reference:
    """Find log10 a and ln b at T_ref.

    Raises
    ------
    InputError
        The WLF law of the fit has its pole between the isotherms and T_ref.
    """
    model, state = found.model, found.fit.state
    count = model.temperature.size
    moves = model.directions(state)[0]
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
        through = _law(model.temperature, state.log10_aT, model.T0, T_ref)
        trend = np.zeros(count + 1) if through is None else through.log10_aT(np.append(model.temperature, T_ref))
        offset = trend[-1] + float(share @ (state.log10_aT - trend[:-1]))
        at_reference = share @ moves
    own = np.zeros(count)
    if model.horizontal == "free":
        # In the frame of the fit, so that differences of shifts know nothing of T_ref.
        own = repeatability(model.temperature, state.log10_aT, propagated_covariance(moves, found.covariance))
    ln_b, by_parameter = model.law_of_b(state.parameters, np.array([T_ref]))
    return Reference(float(offset), float(ln_b[0]), share, at_reference, by_parameter[0], own)


def repeatability(temperature: Floats, log10_aT: Floats, covariance: Floats) -> Floats:
    """Return the standard uncertainty (isotherm,) of every shift by the sweep's own error, in decades.

    Known where a temperature was measured more than once: the shifts of repeats differ by more than their
    uncertainty, and nobody can exclude such differences elsewhere. It is taken as an error of temperature, the larger
    in decades the steeper the shifts are. Zeros where no temperature was repeated.
    """
    order = np.argsort(temperature, kind="stable")
    repeated = np.flatnonzero(np.diff(temperature[order]) < LEAST_SPACING)
    if not repeated.size:
        return np.zeros(temperature.size)
    first, second = order[repeated], order[repeated + 1]
    law = _law(temperature, log10_aT, float(np.median(temperature)), float(np.median(temperature)))
    slope = np.full(temperature.size, np.ptp(log10_aT) / max(np.ptp(temperature), LEAST_SPACING))
    change = log10_aT[first] - log10_aT[second]
    if law is not None:
        slope = np.abs(law.log10_aT(temperature + 0.5) - law.log10_aT(temperature - 0.5))
        change = change - law.log10_aT(temperature[first]) + law.log10_aT(temperature[second])
    known = covariance[first, first] + covariance[second, second] - 2.0 * covariance[first, second]
    squared = np.sum(change**2 - known) / np.sum(slope[first] ** 2 + slope[second] ** 2)
    return np.asarray(np.sqrt(max(float(squared), 0.0)) * slope)


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
