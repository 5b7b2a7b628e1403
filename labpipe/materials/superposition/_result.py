"""The master curve as a result, assembled from a converged fit."""

from __future__ import annotations

import json
import warnings
from dataclasses import dataclass

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.materials._shift_law import LawName, ShiftLaw, fit_law, shift_at
from labpipe.materials.prony import Prony
from labpipe.materials.spectrum import KramersKronig, kramers_kronig
from labpipe.materials.superposition._curve import curve_and_modes, overlap_of_neighbours, predictions, terms_of
from labpipe.materials.superposition._model_selection import Superposition
from labpipe.materials.superposition._points import SweepData
from labpipe.materials.superposition._reference import reference_at
from labpipe.materials.superposition._verdict import Verdict, limits_of, verdict_on
from labpipe.notebook import Shown, ShownAsTable
from labpipe.uncertainty import propagated_u
from labpipe.variables import described

_CURVE_NAMES = ("storage", "loss", "loss_factor")


@dataclass(frozen=True, slots=True, repr=False)
class MasterCurve(ShownAsTable):
    """A master curve, its uncertainties, and the verdict on it.

    Attributes
    ----------
    T_ref : float [degC]
    log10_aT, u_log10_aT : DataArray (temperature,)
        Shift factors and their standard uncertainties, in the order of the sweeps.
    b_T, u_b_T : DataArray (temperature,)
        Vertical factors.
    vertical : {"none", "rho_T", "linear", "quadratic"}
        The vertical law that was used. With "rho_T" of several, b_T holds the fall of the density too.
    delay, u_delay : float [s]
        Delay of the instrument's phase; zero when none was needed.
    nearest_law, laws : ShiftLaw, dict of str to ShiftLaw
        The law that was asked for, or the better of WLF and Arrhenius through the free shifts, even where it does not
        describe them (``law`` is None then, and the shifts count without it). Both laws through the shifts.
    prony, terms : Prony, Dataset over ``term``
        The material at T_ref; ``E``, ``rho``, ``C``, ``tau`` and ``extrapolated`` (outside the covered window).
    kramers_kronig : KramersKronig
    data : Dataset over (``temperature``, ``frequency``)
        ``reduced_frequency``, ``storage_reduced``, ``loss_reduced`` (delay and b_T removed),
        ``storage_residual``, ``loss_residual`` (fitted over measured less one).
    curve : Dataset over ``reduced_frequency``
        ``storage``, ``loss``, their uncertainties, and ``loss_factor`` at T_ref.
    modes : Dataset over ``mode``
        The uncertainty of curve and shifts, as independent changes.
    overlap : Dataset over ``pair``
        Neighbouring temperatures, their step, its uncertainty, the overlap in decades, and whether it is determined.
    noise : dict
        Relative noise of ``storage`` and ``loss`` as found from the residuals.
    verdict, warnings : Verdict, tuple of str
        On time-temperature superposition: pass, doubtful, or fail, with the reasons; limits of the result.
    work : dict
        Counts for the ledger: isotherms, points, terms.
    """

    T_ref: float
    log10_aT: xr.DataArray
    u_log10_aT: xr.DataArray
    b_T: xr.DataArray
    u_b_T: xr.DataArray
    vertical: str
    delay: float
    u_delay: float
    nearest_law: ShiftLaw
    laws: dict[str, ShiftLaw]
    prony: Prony
    terms: xr.Dataset
    kramers_kronig: KramersKronig
    data: xr.Dataset
    curve: xr.Dataset
    modes: xr.Dataset
    overlap: xr.Dataset
    noise: dict[str, float]
    verdict: Verdict
    warnings: tuple[str, ...]
    work: dict[str, int]

    @property
    def law(self) -> ShiftLaw | None:
        """The shift law of the sweeps; None where neither law holds, or one temperature shows none."""
        return self.nearest_law if self.laws and self.nearest_law.holds else None

    def _shown(self) -> Shown:
        name = {"wlf": "WLF law", "arrhenius": "Arrhenius law"}
        law = name[self.law.name] if self.law else "no law holds (free shifts)" if self.laws else "one temperature"
        caption = f"Master curve at {self.T_ref:g} °C, superposition: {self.verdict.level}, {law}; {self.prony!r}"
        columns = (self.log10_aT["temperature"], self.log10_aT, self.u_log10_aT, self.b_T)
        rows = [
            (f"{T:g} °C", f"{a:+.3f} ± {u:.3f}", f"{b:.3f}")
            for T, a, u, b in zip(*(column.values for column in columns), strict=True)
        ]
        return Shown(caption, ("temperature", "log10 a_T", "b_T"), rows)

    def at(self, temperature: float) -> Prony:
        """Return the material at another temperature (°C) by the shifts and their law.

        Raises
        ------
        InputError
            The law has no value there.
        """
        measured = self.log10_aT["temperature"].values, self.log10_aT.values
        log10_aT = shift_at(self.nearest_law, *measured, temperature)
        inside = self.b_T.dropna("temperature").sortby("temperature")
        b_T = np.interp(temperature, inside["temperature"].values, inside.values)
        return self.prony.shifted(10.0**log10_aT, float(b_T))

    def to_dataset(self) -> xr.Dataset:
        """Return shifts, data, curve, terms and overlap as one Dataset for a netCDF file."""
        names = ("log10_aT", "u_log10_aT", "b_T", "u_b_T")
        shifts = xr.Dataset({name: getattr(self, name) for name in names})
        curve = self.curve.rename({name: f"master_{name}" for name in _CURVE_NAMES})
        curve = curve.rename({f"u_{name}": f"u_master_{name}" for name in _CURVE_NAMES[:2]})
        data = self.data.rename({"reduced_frequency": "point_reduced_frequency"})
        merged = xr.merge([shifts, data, curve, self.modes, self.terms, self.overlap])
        merged.attrs = {
            "T_ref": self.T_ref,
            "E_relaxed": self.prony.E_relaxed,
            "nu": self.prony.nu,
            "vertical_law": self.vertical,
            "delay": self.delay,
            "u_delay": self.u_delay,
            "shift_law": self.law.name if self.law else "none",
            "shift_law_parameters": json.dumps(list(self.law.parameters if self.law else ())),
            "kramers_kronig": self.kramers_kronig.verdict,
            "superposition": self.verdict.level,
            "work": json.dumps(self.work),
        }
        return merged


def assembled(sweeps: xr.Dataset, data: SweepData, found: Superposition, T_ref: float, nu: float) -> MasterCurve:
    """Move the reference to T_ref and put the result into Datasets."""
    model, state = found.model, found.fit.state
    reference = reference_at(found, T_ref)
    log10_aT = state.log10_aT - reference.log10_aT
    b_ref = float(np.exp(reference.ln_bT))
    weights = found.fit.solution.coefficient * found.fit.grid.scale * b_ref
    prony = Prony(weights[-1], weights[:-1], np.exp(found.fit.grid.ln_time) * 10.0**reference.log10_aT, nu)
    chosen, laws = _laws(found, reference.covariance, T_ref)
    reduced = predictions(sweeps, data, found, reference, log10_aT)
    names = ("reduced_frequency", "storage_reduced", "loss_reduced")
    columns = np.stack([reduced[name].values[data.row, data.column] for name in names])
    # Where the loss is small its noise may be larger than the remainder without the delay.
    kk = kramers_kronig(*columns[:, columns[2] > 0])
    overlap = overlap_of_neighbours(data, log10_aT, reference.covariance)
    window = (float(columns[0].min()), float(columns[0].max()))
    verdict = verdict_on(found, kk)
    notes = limits_of(data.points, found, chosen, overlap, verdict)
    for note in notes:
        warnings.warn(note, UserWarning, stacklevel=4)
    curve, modes = curve_and_modes(data.points, found, reference, window)
    b_T = np.exp(state.ln_bT - reference.ln_bT)
    by_b = model.directions(state)[1] - reference.vertical_by_parameter
    u_ln_bT = propagated_u(by_b, found.covariance) if model.size else np.zeros(b_T.size)
    is_sloped = model.has_slope and bool(state.parameters[model.horizontal_size])
    u_delay = found.covariance[-1, -1] ** 0.5 * model.delay_unit if model.has_delay else 0.0
    temperature = sweeps["temperature"]

    def over(values: Floats, text: str) -> xr.DataArray:
        """Put values of the used isotherms over all temperatures, NaN elsewhere."""
        full = np.full(temperature.size, np.nan)
        full[data.kept] = values
        coords, attrs = {"temperature": temperature}, described("1", text)
        return xr.DataArray(full, dims="temperature", coords=coords, attrs=attrs)

    u_log10_aT = np.sqrt(np.maximum(np.diag(reference.covariance), 0.0))
    return MasterCurve(
        T_ref=T_ref,
        log10_aT=over(log10_aT, "log10 of the horizontal shift factor"),
        u_log10_aT=over(u_log10_aT, "standard uncertainty of log10_aT"),
        b_T=over(b_T, "vertical shift factor"),
        u_b_T=over(b_T * u_ln_bT, "standard uncertainty of b_T"),
        # A slope that a glass turned out to have is a linear law.
        vertical="linear" if model.vertical == "none" and is_sloped else model.vertical,
        delay=state.delay,
        u_delay=float(u_delay),
        nearest_law=chosen,
        laws=laws,
        prony=prony,
        terms=terms_of(prony, window),
        kramers_kronig=kk,
        data=reduced,
        curve=curve,
        modes=modes,
        overlap=overlap,
        noise={"storage": float(found.noise.storage), "loss": float(found.noise.loss)},
        verdict=verdict,
        warnings=(*data.warnings, *notes),
        work={"isotherms": data.points.count, "points": int(data.points.omega.size), "terms": int(prony.E.size)},
    )


def _laws(found: Superposition, covariance: Floats, T_ref: float) -> tuple[ShiftLaw, dict[str, ShiftLaw]]:
    """Return the law of the fit itself, or the better one through free shifts, and both laws through the shifts.

    They are fitted to the shifts from the reference isotherm, weighed by their covariance.
    """
    model, shifts, at = found.model, found.fit.state.log10_aT, found.model.reference
    distinct = np.unique(model.temperature).size
    names: tuple[LawName, ...] = ("wlf", "arrhenius") if distinct > 2 else ("arrhenius",)
    differences = covariance - covariance[:, [at]] - covariance[[at]] + covariance[at, at]
    usable = differences if np.any(differences) else np.eye(shifts.size)
    laws: dict[str, ShiftLaw] = {}
    for name in names if distinct > 1 else ():
        law = fit_law(name, model.temperature, shifts - shifts[at], usable, model.T0)
        if (moved := law.about(T_ref)) is not None:
            laws[name] = moved
    if model.horizontal in ("wlf", "arrhenius"):
        size = model.horizontal_size
        parameters = tuple(float(p) for p in found.fit.state.parameters[:size])
        own = ShiftLaw(model.horizontal, model.T0, parameters, found.covariance[:size, :size]).about(T_ref)
        if own is not None:
            return own, laws
    # One more constant has to pay for itself (Schwarz).
    price, none = float(np.log(model.temperature.size)), ShiftLaw("arrhenius", T_ref, (0.0,), np.full((1, 1), np.nan))
    return min(laws.values(), key=lambda one: one.chi_square + price * len(one.parameters), default=none), laws
