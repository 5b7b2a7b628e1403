r"""Master curves by time-temperature superposition, with uncertainties and an honest report.

Convention: E(ω, T) = b_T E(a_T ω, T_ref). The horizontal factor a_T exceeds one below the
reference temperature; the vertical factor b_T is one there.

One joint fit finds all shifts and one non-negative spectrum from both moduli. Chained pairwise
shifts accumulate errors and know no covariance; the joint fit does neither. What the data cannot
determine is said: the standard deviation of every shift, the overlap of every pair, the agreement
of the starts, the Kramers-Kronig verdict, and which terms lie outside the covered window.
"""

import json
import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from labpipe.errors import InputError
from labpipe.materials.anchoring import anchor_at
from labpipe.materials.kramers_kronig import KramersKronig, kramers_kronig
from labpipe.materials.outer_model import Horizontal, OuterModel, Vertical
from labpipe.materials.prony import Prony
from labpipe.materials.shift_law import LawName, ShiftLaw, fit_law
from labpipe.materials.superposition import Superposition, free_shifts_gain, superpose
from labpipe.materials.superposition_report import (
    bands,
    overlap_of_neighbours,
    predictions,
    terms_of,
)
from labpipe.materials.sweep_data import SweepData, read_sweeps

Array = NDArray[np.float64]

_LN10 = float(np.log(10.0))
_ALL_VERTICALS: tuple[Vertical, ...] = ("none", "rho_T", "linear", "quadratic")
#: A step between neighbours known worse than this (decades) is called barely determined.
BARELY_DETERMINED = 0.15
# Another start that ends this far away (decades) at nearly the same cost (in units of twice the
# log-likelihood) is a second solution.
_OTHER_SOLUTION, _NEARLY_SAME_COST = 0.15, 6.0
# Levels about a vertical law are looked for from this many isotherms on.
_LEVELS_NEED = 5
# A law holds when free shifts lower the misfit by less than this per parameter (F statistic).
_LAW_HOLDS = 4.0


@dataclass(frozen=True, slots=True)
class MasterCurve:
    """A master curve and everything the report says about it.

    Attributes
    ----------
    T_ref : float [degC]
    log10_aT, u_log10_aT : DataArray (temperature,)
        Shift factors and their standard uncertainties, in the order of the sweeps.
    covariance : DataArray (temperature, temperature_2)
        Of ``log10_aT``.
    b_T, u_b_T : DataArray (temperature,)
        Vertical factors.
    level : DataArray (temperature,)
        Level of every sweep about the vertical law, one where none was needed.
    vertical : {"none", "rho_T", "linear", "quadratic"}
        The vertical law that was used.
    delay, u_delay : float [s]
        Delay of the instrument's phase; zero when none was needed.
    law : ShiftLaw
        The law that was asked for, or the better of WLF and Arrhenius through the free shifts.
    laws : dict of str to ShiftLaw
        Both laws through the shifts; their ``chi_square`` over ``freedom`` says which holds.
    prony : Prony
        The material at T_ref.
    terms : Dataset over ``term``
        ``E``, ``rho``, ``C``, ``tau`` and ``extrapolated`` (outside the covered window).
    kramers_kronig : KramersKronig
    data : Dataset over (``temperature``, ``frequency``)
        ``reduced_frequency``, ``storage_reduced``, ``loss_reduced`` (delay and b_T removed),
        ``storage_fitted``, ``loss_fitted`` (in the frame of the measurement), residuals.
    curve : Dataset over ``reduced_frequency``
        ``storage``, ``loss``, their uncertainties, and ``loss_factor`` at T_ref.
    overlap : Dataset over ``pair``
        Neighbouring temperatures, their step, its uncertainty, the overlap in decades, and
        whether the step is ``determined``.
    noise : dict
        Relative noise of ``storage`` and ``loss`` as found from the residuals.
    starts : tuple of (str, float, float)
        Name of every start, final cost, largest distance of its shifts from the best ones.
    warnings : tuple of str
    work : dict
        Counts for the ledger: isotherms, points, terms.
    """

    T_ref: float
    log10_aT: xr.DataArray
    u_log10_aT: xr.DataArray
    covariance: xr.DataArray
    b_T: xr.DataArray
    u_b_T: xr.DataArray
    level: xr.DataArray
    vertical: str
    delay: float
    u_delay: float
    law: ShiftLaw
    laws: dict[str, ShiftLaw]
    prony: Prony
    terms: xr.Dataset
    kramers_kronig: KramersKronig
    data: xr.Dataset
    curve: xr.Dataset
    overlap: xr.Dataset
    noise: dict[str, float]
    starts: tuple[tuple[str, float, float], ...]
    warnings: tuple[str, ...]
    work: dict[str, int]

    def at(self, temperature: float) -> Prony:
        """Return the material at another temperature (°C) by the fitted laws.

        Raises
        ------
        InputError
            The law has no value there.
        """
        log10_aT = float(self.law.log10_aT(temperature))
        inside = self.b_T.dropna("temperature").sortby("temperature")
        b_T = np.interp(temperature, inside["temperature"].values, inside.values)
        return self.prony.shifted(10.0**log10_aT, float(b_T))

    def to_dataset(self) -> xr.Dataset:
        """Return shifts, data, curve, terms and overlap as one Dataset for a netCDF file."""
        shifts = xr.Dataset(
            {
                "log10_aT": self.log10_aT,
                "u_log10_aT": self.u_log10_aT,
                "covariance": self.covariance,
                "b_T": self.b_T,
                "u_b_T": self.u_b_T,
                "level": self.level,
            }
        )
        curve = self.curve.rename({name: f"master_{name}" for name in _CURVE_NAMES})
        curve = curve.rename({f"u_{name}": f"u_master_{name}" for name in _CURVE_NAMES[:2]})
        data = self.data.rename({"reduced_frequency": "point_reduced_frequency"})
        merged = xr.merge([shifts, data, curve, self.terms, self.overlap])
        merged.attrs = {
            "T_ref": self.T_ref,
            "E_relaxed": self.prony.E_relaxed,
            "nu": self.prony.nu,
            "vertical_law": self.vertical,
            "delay": self.delay,
            "u_delay": self.u_delay,
            "shift_law": self.law.name,
            "shift_law_parameters": json.dumps(list(self.law.parameters)),
            "kramers_kronig": self.kramers_kronig.verdict,
            "work": json.dumps(self.work),
        }
        return merged


_CURVE_NAMES = ("storage", "loss", "loss_factor")


def master_curve(
    sweeps: xr.Dataset,
    T_ref: float | None = None,
    law: LawName | None = None,
    *,
    vertical: Literal["auto", "none", "rho_T", "linear", "quadratic"] = "auto",
    delay: bool | Literal["auto"] = "auto",
    levels: bool | Literal["auto"] = "auto",
    robust: bool = True,
    noise_ratio: float | None = None,
    shifts: ArrayLike | None = None,
    refine: bool = True,
    nu: float = 0.5,
) -> MasterCurve:
    """Shift isothermal sweeps onto one curve and fit its spectrum, all at once.

    Parameters
    ----------
    sweeps : Dataset
        ``storage`` and ``loss`` [Pa] over ``temperature`` [degC] and ``frequency`` [Hz]; NaN
        where a sweep has no point. Any order; repeated temperatures keep a shift each.
    T_ref : float, optional [degC]
        Reference temperature within the measured range (a law may reach beyond); default the
        middle isotherm. It need not be one of the temperatures.
    law : {None, "wlf", "arrhenius"}
        None leaves every shift free; a law replaces them by its one or two constants.
    vertical : str
        Law of b_T: "none", "rho_T" (b ∝ absolute temperature), "linear" or "quadratic"
        (ln b_T in T − T_ref); "auto" takes what Schwarz's criterion asks for.
    delay : bool or "auto"
        Whether the instrument's phase lags by a constant time.
    levels : bool or "auto"
        Whether every sweep has a small level of its own about the vertical law, as after
        clamping or tempering the sample anew; kept apart in ``level``, not part of b_T.
    robust : bool
        Weaken residuals beyond three standard deviations.
    noise_ratio : float, optional
        Relative noise of the loss over that of the storage modulus; default estimated from the
        residuals. 10 makes the storage modulus dominate, for glasses whose loss is not trusted.
    shifts : array (temperature,), optional
        Hand-set log10 a_T, in the order of the sweeps, relative to any temperature.
    refine : bool
        Use hand-set shifts as the start of the fit (True) or as they are (False).
    nu : float
        Poisson's ratio of the material, handed on to ``prony``.

    Returns
    -------
    MasterCurve

    Raises
    ------
    InputError
        The sweeps are not usable (the message says where), T_ref lies outside the range of free
        shifts, or an option is unknown.

    Warns
    -----
    UserWarning
        For everything that limits the result; the same lines are in ``warnings``.

    Notes
    -----
    Residuals are relative to the noise of either modulus. Free shifts carry a weak expectation
    of how polymers shift (:func:`labpipe.materials.outer_model.expected_shifts`), which matters
    only where the data say nothing. Uncertainties come from the projected normal matrix and
    take the model (superposition, one spectrum) for granted.

    References
    ----------
    Golub & Pereyra, Inverse Problems 19 (2003) R1, doi:10.1088/0266-5611/19/2/201.
    """
    data = read_sweeps(sweeps)
    _check_options(law, vertical, delay, levels, noise_ratio)
    given = None if shifts is None else _given_shifts(shifts, sweeps, data)
    reference = _reference(data.temperature, T_ref)
    where = float(data.temperature[reference]) if T_ref is None else float(T_ref)
    horizontal: Horizontal = law or "free"
    if given is not None and not refine:
        horizontal = "fixed"
    _check_reference(data.temperature, where, horizontal)
    if data.points.count == 1:
        horizontal = "fixed"
    model = OuterModel(
        temperature=data.temperature,
        T_ref=where,
        reference=reference,
        given=np.zeros(data.points.count) if given is None else given - given[reference],
        delay_unit=1.0 / float(np.max(data.points.omega)),
        horizontal=horizontal,
    )
    found = superpose(
        data.points,
        model,
        starts=(("given", model.given),) if given is not None or horizontal == "fixed" else None,
        verticals=_verticals(vertical, data.points.count),
        delay=None if delay == "auto" else delay,
        levels=_levels(levels, data.points.count),
        robust=robust,
        noise_ratio=noise_ratio,
    )
    return _assembled(sweeps, data, found, law, nu)


def _verticals(vertical: str, count: int) -> tuple[Vertical, ...]:
    """One isotherm has no vertical shift; two cannot carry two parameters."""
    if count == 1:
        return ("none",)
    if vertical == "auto":
        return _ALL_VERTICALS if count > 3 else ("none",)
    return (vertical,)  # type: ignore[return-value]


def _levels(levels: bool | Literal["auto"], count: int) -> bool | None:
    """Levels need enough isotherms to tell their spread from a law."""
    if count < _LEVELS_NEED:
        return False
    return None if levels == "auto" else levels


def _check_options(
    law: str | None, vertical: str, delay: object, levels: object, noise_ratio: float | None
) -> None:
    for name, value, allowed in (
        ("law", law, (None, "wlf", "arrhenius")),
        ("vertical", vertical, ("auto", *_ALL_VERTICALS)),
        ("delay", delay, (True, False, "auto")),
        ("levels", levels, (True, False, "auto")),
    ):
        if value not in allowed:
            message = (
                f"{name} = {value!r} is unknown; expected one of {', '.join(map(repr, allowed))}"
            )
            raise InputError(message)
    if noise_ratio is not None and not (np.isfinite(noise_ratio) and noise_ratio > 0):
        message = f"noise_ratio = {noise_ratio}: expected a positive number (loss over storage)"
        raise InputError(message)


def _given_shifts(shifts: ArrayLike, sweeps: xr.Dataset, data: SweepData) -> Array:
    values = np.asarray(shifts, dtype=float)
    count = sweeps.sizes["temperature"]
    if values.shape != (count,) or not np.isfinite(values[data.kept]).all():
        message = (
            f"shifts has shape {values.shape}; expected one finite log10 a_T for each of the "
            f"{count} temperatures, in their order"
        )
        raise InputError(message)
    return values[data.kept]


def _reference(temperature: Array, T_ref: float | None) -> int:
    """Return the isotherm nearest to T_ref, or the middle one."""
    if T_ref is None:
        return int(np.argsort(temperature, kind="stable")[temperature.size // 2])
    return int(np.argmin(np.abs(temperature - T_ref)))


def _check_reference(temperature: Array, T_ref: float, horizontal: Horizontal) -> None:
    low, high = float(temperature.min()), float(temperature.max())
    if not np.isfinite(T_ref):
        message = f"T_ref = {T_ref}: expected a temperature in °C"
        raise InputError(message)
    if temperature.size == 1 and abs(T_ref - low) > _SAME_TEMPERATURE:
        message = (
            f"one temperature ({low:g} °C) cannot be shifted to T_ref = {T_ref:g} °C; set "
            f"T_ref={low:g} or measure more temperatures"
        )
        raise InputError(message)
    inside = low - _SAME_TEMPERATURE <= T_ref <= high + _SAME_TEMPERATURE
    if not inside and horizontal in ("free", "fixed"):
        message = (
            f"T_ref = {T_ref:g} °C lies outside the measured {low:g} to {high:g} °C; free shifts "
            'cannot reach it: choose T_ref inside, or law="wlf"'
        )
        raise InputError(message)


# Measured means differ from set temperatures by this much (K) at most.
_SAME_TEMPERATURE = 1.0


def _assembled(
    sweeps: xr.Dataset, data: SweepData, found: Superposition, law: LawName | None, nu: float
) -> MasterCurve:
    """Move the reference to T_ref and put the result into Datasets."""
    model, state = found.model, found.fit.state
    anchor = anchor_at(found)
    log10_aT = state.log10_aT - anchor.offset
    covariance = anchor.covariance
    scale = found.fit.grid.scale
    weights = found.fit.solution.coefficient * scale
    times = np.exp(found.fit.grid.ln_time) * 10.0**anchor.offset
    prony = Prony(weights[-1], weights[:-1], times, nu)
    laws = _laws(model, log10_aT, covariance)
    chosen = _chosen_law(found, law, laws)
    reduced = predictions(sweeps, data, found, log10_aT)
    kk = kramers_kronig(*(reduced[name].values[data.row, data.column] for name in _REDUCED_NAMES))
    overlap = overlap_of_neighbours(data, log10_aT, covariance, BARELY_DETERMINED)
    window = (
        float(np.nanmin(reduced["reduced_frequency"])),
        float(np.nanmax(reduced["reduced_frequency"])),
    )
    notes = _notes(data, found, law, chosen, overlap, kk)
    for note in notes:
        warnings.warn(note, UserWarning, stacklevel=4)
    temperature = sweeps["temperature"]
    levels = model.levels(state.parameters)
    law_b_T = np.exp(state.ln_bT - levels)
    tail = found.covariance[model.size - 1, model.size - 1] if model.has_delay else 0.0
    return MasterCurve(
        T_ref=model.T_ref,
        log10_aT=_over(temperature, data, log10_aT, "1", "log10 of the horizontal shift factor"),
        u_log10_aT=_over(
            temperature, data, np.sqrt(np.diag(covariance)), "1", "standard uncertainty of log10_aT"
        ),
        covariance=_matrix_over(temperature, data, covariance),
        b_T=_over(temperature, data, law_b_T, "1", "vertical shift factor"),
        u_b_T=_over(
            temperature,
            data,
            law_b_T * _u_ln_bT(found),
            "1",
            "standard uncertainty of b_T",
        ),
        level=_over(
            temperature, data, np.exp(levels), "1", "level of the sweep about the vertical law"
        ),
        vertical=model.vertical,
        delay=state.delay,
        u_delay=float(np.sqrt(tail)) * model.delay_unit,
        law=chosen,
        laws=laws,
        prony=prony,
        terms=terms_of(prony, window),
        kramers_kronig=kk,
        data=reduced,
        curve=bands(data.points, found, anchor, window),
        overlap=overlap,
        noise={"storage": float(found.noise.storage), "loss": float(found.noise.loss)},
        starts=found.starts,
        warnings=(*data.warnings, *notes),
        work={
            "isotherms": data.points.count,
            "points": int(data.points.omega.size),
            "terms": int(prony.E.size),
        },
    )


_REDUCED_NAMES = ("reduced_frequency", "storage_reduced", "loss_reduced")


def _u_ln_bT(found: Superposition) -> Array:
    """Return the standard uncertainty of ln b_T of every isotherm."""
    if not found.model.size:
        return np.zeros(found.model.temperature.size)
    rows = found.model.directions(found.fit.state)[1]
    rows[:, found.model.level_slice] = 0.0
    return np.sqrt(np.einsum("kp,pq,kq->k", rows, found.covariance, rows))


def _laws(model: OuterModel, log10_aT: Array, covariance: Array) -> dict[str, ShiftLaw]:
    """Fit both laws through the shifts; the weights come from their covariance."""
    names: tuple[LawName, ...] = (
        ("wlf", "arrhenius") if model.temperature.size > 2 else ("arrhenius",)
    )
    if model.temperature.size < 2:
        names = ()
    usable = covariance if np.any(covariance) else np.eye(log10_aT.size)
    return {name: fit_law(name, model.temperature, log10_aT, usable, model.T_ref) for name in names}


def _chosen_law(found: Superposition, law: LawName | None, laws: dict[str, ShiftLaw]) -> ShiftLaw:
    """Return the law of the fit itself, or the better one through free shifts."""
    model = found.model
    if model.horizontal in ("wlf", "arrhenius"):
        size = model.horizontal_size
        return ShiftLaw(
            model.horizontal,  # type: ignore[arg-type]
            model.T_ref,
            tuple(float(p) for p in found.fit.state.parameters[:size]),
            found.covariance[:size, :size],
        )
    if not laws:
        return ShiftLaw("arrhenius", model.T_ref, (0.0,), np.full((1, 1), np.nan))
    # One more constant has to pay for itself (Schwarz).
    price = float(np.log(model.temperature.size))
    return min(laws.values(), key=lambda one: one.chi_square + price * len(one.parameters))


def _notes(
    data: SweepData,
    found: Superposition,
    law: LawName | None,
    chosen: ShiftLaw,
    overlap: xr.Dataset,
    kk: KramersKronig,
) -> list[str]:
    """Say everything that limits the result, one sentence each."""
    notes: list[str] = []
    if data.points.count == 1:
        notes.append("one temperature only: there is nothing to shift, the spectrum is its own")
    if found.model.horizontal == "free":
        notes += _identifiability(overlap)
        notes += _other_solutions(found)
    for k in np.flatnonzero(overlap["overlap"].values <= 0):
        pair = overlap.isel(pair=int(k))
        notes.append(
            f"{float(pair['colder']):g} and {float(pair['warmer']):g} °C do not overlap "
            f"({-float(pair['overlap']):.2f} decades apart); their step rests on the link between "
            "storage and loss alone"
        )
    if law is not None and data.points.count > len(chosen.parameters) + 1:
        gain = free_shifts_gain(data.points, found)
        if gain > _LAW_HOLDS:
            notes.append(
                f"the {law} law does not hold over these temperatures: free shifts fit better "
                f"(F = {gain:.1f}); use law=None and look for a transition"
            )
    if kk.verdict != "pass":
        notes.append(f"Kramers-Kronig {kk.verdict}: {kk.reason}")
    return notes


def _identifiability(overlap: xr.Dataset) -> list[str]:
    loose = overlap.isel(pair=np.flatnonzero(~overlap["determined"].values))
    if not loose.sizes["pair"]:
        return []
    pairs = ", ".join(
        f"{float(a):g}/{float(b):g} °C (±{float(u):.2f})"
        for a, b, u in zip(loose["colder"], loose["warmer"], loose["u_step"], strict=True)
    )
    return [
        f"the data barely determine the step of log10 a_T between {pairs}; there the shifts rest on "
        "the expected continuation. Smaller temperature steps, a wider frequency range or a shift "
        "law would help"
    ]


def _other_solutions(found: Superposition) -> list[str]:
    best = found.starts[0][1]
    others = [
        (name, distance)
        for name, cost, distance in found.starts[1:]
        if distance > _OTHER_SOLUTION and cost - best < _NEARLY_SAME_COST
    ]
    return [
        f'the start "{name}" ends {distance:.2f} decades away at nearly the same misfit: the shifts '
        "have a second solution"
        for name, distance in others
    ]


def _over(
    temperature: xr.DataArray, data: SweepData, values: Array, units: str, name: str
) -> xr.DataArray:
    """Put values of the used isotherms over all temperatures, NaN elsewhere."""
    full = np.full(temperature.size, np.nan)
    full[data.kept] = values
    coordinate = {"temperature": temperature}
    attrs = {"units": units, "long_name": name}
    return xr.DataArray(full, dims="temperature", coords=coordinate, attrs=attrs)


def _matrix_over(temperature: xr.DataArray, data: SweepData, values: Array) -> xr.DataArray:
    full = np.full((temperature.size,) * 2, np.nan)
    full[np.ix_(data.kept, data.kept)] = values
    other = ("temperature_2", temperature.values, {"units": "degC", "long_name": "temperature"})
    return xr.DataArray(
        full,
        dims=("temperature", "temperature_2"),
        coords={"temperature": temperature, "temperature_2": other},
        attrs={"units": "1", "long_name": "covariance of log10_aT"},
    )
