r"""Master curves by time-temperature superposition, with uncertainties and warnings.

Convention: E(ω, T) = b_T E(a_T ω, T_ref). The horizontal factor a_T exceeds one below the
reference temperature; the vertical factor b_T is one there.

One joint fit finds all shifts and one non-negative spectrum from both moduli. The limits of the data are stated: the
standard deviation of every shift, the overlap of every pair, the agreement of the starts, the Kramers-Kronig verdict,
and which terms lie outside the covered window.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
import xarray as xr
from threadpoolctl import threadpool_limits

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials._shift_law import LawName
from labpipe.materials._step_tests import with_responses
from labpipe.materials.superposition._joint_fit import Points
from labpipe.materials.superposition._model_selection import Options, superpose
from labpipe.materials.superposition._parameters import (
    GLASS,
    LEAST_SPACING,
    SLOPE_SPREAD,
    VERTICAL_SIZE,
    Horizontal,
    OuterModel,
    Vertical,
)
from labpipe.materials.superposition._points import read_sweeps
from labpipe.materials.superposition._result import MasterCurve, assembled
from labpipe.materials.superposition._sweeps import Mode, gather_sweeps, loading_asked_for
from labpipe.units import Measure, si

_READINGS = {"storage_modulus", "relaxation_modulus", "creep_compliance"}


def master_curve(
    sweeps: xr.Dataset | Sequence[xr.Dataset],
    T_ref: Measure | None = None,
    law: LawName | None = None,
    *,
    vertical: Literal["auto", "none", "rho_T", "linear", "quadratic"] = "auto",
    delay: bool | Literal["auto"] = "auto",
    nu: Measure | None = None,
    mode: Mode | None = None,
) -> MasterCurve:
    """Shift isothermal sweeps onto one curve and fit its spectrum, all at once.

    Parameters
    ----------
    sweeps : Dataset, or sequence of Dataset
        ``storage`` and ``loss`` [Pa] in tension over ``temperature`` [degC] and ``frequency`` [Hz]; NaN
        where a sweep has no point. Any order; repeated temperatures keep a shift each. Or the
        readings of a rheometer's export, one or several, whose isothermal sweeps are gathered first
        (:func:`labpipe.materials.gather_sweeps`); relaxation and creep tests at several temperatures become
        sweeps (:func:`labpipe.materials.with_responses`), whose moduli count as the terms that they come from.
    T_ref : float or text with a unit, optional [degC]
        Reference temperature within the measured range (a law may reach beyond); default the
        middle isotherm. It need not be one of the temperatures.
    law : {None, "wlf", "arrhenius"}
        None leaves every shift free; a law replaces them by its one or two constants.
    vertical : str
        Law of b_T: "none", "rho_T" (b ∝ absolute temperature), "linear" or "quadratic"
        (in T − T_ref); "auto" takes the law that Schwarz's criterion asks for.
    delay : bool or "auto"
        Lag of the instrument's phase by a constant time.
    nu : float
        Poisson's ratio of the material, handed on to ``prony``. Of readings it has to be given; of
        ``storage`` and ``loss`` it is 0.5 unless given.
    mode : {"tension", "bending", "shear", "torsion"}
        The loading, where readings are given; shear moduli become E = 2 (1 + ν) G. By default that of the
        column of strain or modulus, if it shows shear or extension; another one is refused.

    Returns
    -------
    MasterCurve

    Raises
    ------
    InputError
        The sweeps are not usable (the message says where), mode or Poisson's ratio of readings is missing, or the
        mode contradicts their headings; T_ref lies outside the range of free shifts, or an option is unknown.

    Warns
    -----
    UserWarning
        For everything that limits the result; the same lines are in ``warnings``.

    Notes
    -----
    Readings that lie far off their own sweep (more than a third) are left out. Residuals are relative to the noise of
    either modulus. Free shifts carry a weak expectation of how polymers shift (:func:`.expected_shifts`), which
    matters only where the data say nothing. Uncertainties come from the projected normal matrix, widened by the lack of
    fit and by the choices of smoothing and vertical law.

    References
    ----------
    Golub & Pereyra, Inverse Problems 19 (2003) R1, doi:10.1088/0266-5611/19/2/201.

    Examples
    --------
    >>> curve = master_curve(lp.read("acrylic.csv"), "20 °C", mode="torsion", nu=0.35)  # doctest: +SKIP
    >>> curve.at(39.0).relaxation(1e-3)  # doctest: +SKIP
    """
    sweeps, nu = _in_tension(sweeps, mode, nu)
    data = read_sweeps(sweeps)
    points, temperature = data.points, data.temperature
    for name, value, allowed in (
        ("law", law, (None, "wlf", "arrhenius")),
        ("vertical", vertical, ("auto", *VERTICAL_SIZE)),
        ("delay", delay, (True, False, "auto")),
    ):
        if value not in allowed:
            raise InputError(f"{name} = {value!r} is unknown; expected one of {', '.join(map(repr, allowed))}")
    horizontal: Horizontal = "fixed" if points.count == 1 else law or "free"
    reference = int(np.argsort(temperature, kind="stable")[temperature.size // 2])
    where = float(temperature[reference]) if T_ref is None else si(T_ref, "degC", "T_ref")
    _check_reference(temperature, where, horizontal)
    is_glass = points.count > 1 and bool(points.storage.min() > GLASS)
    model = OuterModel(
        temperature=temperature,
        reference=reference,
        given=np.zeros(points.count),
        delay_unit=1.0 / float(np.max(points.omega)),
        horizontal=horizontal,
        slope_spread=SLOPE_SPREAD if vertical == "auto" and is_glass else 0.0,
    )
    options = Options(
        verticals=_verticals(vertical, points, is_glass),
        delay=None if delay == "auto" else delay,
        moduli_per_parameter=float(sweeps.attrs.get("moduli_per_parameter", 1.0)),
        least_noise=float(sweeps.attrs.get("u_moduli", 0.0)),
    )
    # Thousands of small systems: more threads of linear algebra would only wait for each other.
    with threadpool_limits(limits=1, user_api="blas"):
        return assembled(sweeps, data, superpose(points, model, options), where, nu)


def _in_tension(
    sweeps: xr.Dataset | Sequence[xr.Dataset], mode: Mode | None, nu: Measure | None
) -> tuple[xr.Dataset, float]:
    """Return sweeps in tension and Poisson's ratio; readings are gathered first."""
    if isinstance(sweeps, str | Path):
        raise InputError(
            f"master_curve takes readings, not the name of a file: "
            f'master_curve(lp.read("{sweeps}"), T_ref=..., mode=..., nu=...)'
        )
    parts = [sweeps] if isinstance(sweeps, xr.Dataset) else list(sweeps) if isinstance(sweeps, list | tuple) else []
    if not parts or not all(isinstance(part, xr.Dataset) for part in parts):
        raise InputError(
            f"master_curve takes a Dataset, found {type(sweeps).__name__}: the readings of lp.read(file), or storage "
            "and loss (Pa) over temperature (°C) and frequency (Hz)"
        )
    ratio = None if nu is None else si(nu, "1", "nu")
    if len(parts) == 1 and not _READINGS & set(map(str, parts[0].variables)):
        return parts[0], 0.5 if ratio is None else ratio
    mode, nu = loading_asked_for(parts, mode, ratio)
    return gather_sweeps([with_responses(part) for part in parts], mode, nu), nu


def _verticals(vertical: str, points: Points, is_glass: bool) -> tuple[Vertical, ...]:
    """One isotherm has no vertical shift; two cannot carry two parameters.

    A modulus that grows as T does is one of entropy: that of a network or a melt, not of a glass.
    """
    if points.count == 1:
        return ("none",)
    if vertical == "auto":
        laws = tuple(law for law in VERTICAL_SIZE if not (law == "rho_T" and is_glass))
        return laws if points.count > 3 else ("none",)
    return (vertical,)  # type: ignore[return-value]


def _check_reference(temperature: Floats, T_ref: float, horizontal: Horizontal) -> None:
    low, high = float(temperature.min()), float(temperature.max())
    if not np.isfinite(T_ref):
        raise InputError(f"T_ref = {T_ref}: expected a temperature in °C")
    if temperature.size == 1 and abs(T_ref - low) > LEAST_SPACING:
        raise InputError(
            f"one temperature ({low:g} °C) cannot be shifted to T_ref = {T_ref:g} °C; set "
            f"T_ref={low:g} or measure more temperatures"
        )
    inside = low - LEAST_SPACING <= T_ref <= high + LEAST_SPACING
    if not inside and horizontal in ("free", "fixed"):
        raise InputError(
            f"T_ref = {T_ref:g} °C lies outside the measured {low:g} to {high:g} °C; free shifts "
            'cannot reach it: choose T_ref inside, or law="wlf"'
        )
