"""The master curve as a result, assembled from a converged fit."""

from __future__ import annotations

import json
import os
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import xarray as xr

from labpipe import files
from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials._fem_export import CODES, Bulk, Code, deck_text, make_deck
from labpipe.materials._shift_law import LawName, ShiftLaw, fit_law, shift_at
from labpipe.materials.prony import Prony
from labpipe.materials.spectrum import KramersKronig, kramers_kronig
from labpipe.materials.superposition._curve import (
    curve_and_modes,
    overlap_of_neighbours,
    predictions,
    terms_of,
    without_delay,
)
from labpipe.materials.superposition._model_selection import Superposition
from labpipe.materials.superposition._points import SweepData
from labpipe.materials.superposition._reference import reference_at
from labpipe.materials.superposition._verdict import Verdict, limits_of, verdict_on
from labpipe.notebook import Shown, ShownAsTable
from labpipe.uncertainty import propagated_u
from labpipe.variables import described, variable

_CURVE_NAMES = ("storage", "loss", "loss_factor")


@dataclass(frozen=True, slots=True, repr=False)
class MasterCurve(ShownAsTable):
    """A master curve, its uncertainties, and the verdict on it.

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
        The vertical law that was used. With "rho_T" of several, b_T holds the fall of the density too.
    delay, u_delay : float [s]
        Delay of the instrument's phase; zero when none was needed.
    law : ShiftLaw
        The law that was asked for, or the better of WLF and Arrhenius through the free shifts; ``law.holds``
        is False where it does not describe them, and the shifts then count without a law.
    laws : dict of str to ShiftLaw
        Both laws through the shifts, with their ``chi_square`` and ``freedom``.
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
    modes : Dataset over ``mode``
        The uncertainty of curve and shifts, as independent changes.
    overlap : Dataset over ``pair``
        Neighbouring temperatures, their step, its uncertainty, the overlap in decades, and
        ``determined``, True where the data determine the step.
    noise : dict
        Relative noise of ``storage`` and ``loss`` as found from the residuals.
    verdict : Verdict
        On time-temperature superposition: pass, doubtful, or fail, with the reasons.
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
    modes: xr.Dataset
    overlap: xr.Dataset
    noise: dict[str, float]
    verdict: Verdict
    warnings: tuple[str, ...]
    work: dict[str, int]

    def _shown(self) -> Shown:
        name = {"wlf": "WLF", "arrhenius": "Arrhenius"}[self.law.name]
        law = f"{name} law" if self.law.holds else "no law holds (free shifts)"
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
        log10_aT = shift_at(self.law, *measured, temperature)
        inside = self.b_T.dropna("temperature").sortby("temperature")
        b_T = np.interp(temperature, inside["temperature"].values, inside.values)
        return self.prony.shifted(10.0**log10_aT, float(b_T))

    def export(
        self,
        path: str | os.PathLike[str],
        code: Code | None = None,
        *,
        bulk: Bulk | None = None,
        measured: Literal["tension", "shear"] = "tension",
        tolerance: float = 0.01,
        name: str | None = None,
    ) -> Path:
        """Write the material as input of a simulation code, with its validity and shift law.

        Parameters
        ----------
        path : path-like
            The file; its suffix is that of the code: ``.inp`` Abaqus, ``.mac`` ANSYS, ``.txt`` COMSOL,
            ``.k`` LS-DYNA, ``.json``.
        code : {"abaqus", "ansys", "comsol", "lsdyna", "json"}, optional
            Where the suffix is another.
        bulk, measured, tolerance, name
            As of :func:`labpipe.materials.make_deck`; the name by default that of the file.

        Returns
        -------
        Path

        Raises
        ------
        InputError
            The code is unknown, or the bulk modulus cannot be as asked for.

        Warns
        -----
        UserWarning
            Where the instantaneous or the long-time modulus is extrapolated.
        """
        target = Path(path)
        known = next((c for c, suffix in CODES.items() if target.suffix.lower() == suffix), None)
        chosen = code or known
        if chosen not in CODES:
            raise InputError(f'code "{chosen or target.suffix}" is unknown; expected one of {", ".join(CODES)}')
        window = self.curve["reduced_frequency"].values
        deck = make_deck(
            self.prony,
            (float(window.min()), float(window.max())),
            self.T_ref,
            name=name or target.stem,
            law=self.law,
            shifts=(self.log10_aT["temperature"].values, self.log10_aT.values),
            b_T=self.b_T.values,
            bulk=bulk,
            measured=measured,
            tolerance=tolerance,
        )
        for text in deck.warnings:
            warnings.warn(text, UserWarning, stacklevel=2)
        files.write_text(target, deck_text(deck, chosen))
        return target

    def to_dataset(self) -> xr.Dataset:
        """Return shifts, data, curve, terms and overlap as one Dataset for a netCDF file."""
        names = ("log10_aT", "u_log10_aT", "covariance", "b_T", "u_b_T", "level")
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
            "shift_law": self.law.name,
            "shift_law_parameters": json.dumps(list(self.law.parameters)),
            "kramers_kronig": self.kramers_kronig.verdict,
            "superposition": self.verdict.level,
            "work": json.dumps(self.work),
        }
        return merged


def assembled(sweeps: xr.Dataset, data: SweepData, found: Superposition, T_ref: float, nu: float) -> MasterCurve:
    """Move the reference to T_ref and put the result into Datasets."""
    model, state = found.model, found.fit.state
    reference = reference_at(data.points, found, T_ref)
    log10_aT = state.log10_aT - reference.log10_aT
    b_ref = float(np.exp(reference.ln_bT))
    weights = found.fit.solution.coefficient * found.fit.grid.scale * b_ref
    prony = Prony(weights[-1], weights[:-1], np.exp(found.fit.grid.ln_time) * 10.0**reference.log10_aT, nu)
    laws = _laws(found, reference.covariance, T_ref)
    chosen = _chosen_law(found, laws, T_ref)
    reduced = predictions(sweeps, data, found, reference, log10_aT)
    moduli = without_delay(data.points, found.fit) * b_ref
    frequency = data.points.omega / (2.0 * np.pi) * 10.0 ** log10_aT[data.points.isotherm]
    # Where the loss is small its noise may be larger than the remainder without the delay.
    lossy = moduli.imag > 0
    kk = kramers_kronig(frequency[lossy], moduli.real[lossy], moduli.imag[lossy])
    overlap = overlap_of_neighbours(data, log10_aT, reference.covariance)
    window = (float(np.nanmin(reduced["reduced_frequency"])), float(np.nanmax(reduced["reduced_frequency"])))
    verdict = verdict_on(found, kk)
    notes = limits_of(data.points, found, chosen, overlap, verdict)
    for note in notes:
        warnings.warn(note, UserWarning, stacklevel=4)
    curve, modes = curve_and_modes(data.points, found, reference, window)
    levels = model.levels(state.parameters)
    law_b_T = np.exp(state.ln_bT - levels - reference.ln_bT)
    by_b = model.directions(state)[1] - reference.vertical_by_parameter
    by_b[:, model.level_slice] = 0.0
    u_ln_bT = propagated_u(by_b, found.covariance) if model.size else np.zeros(levels.size)
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
    full = np.full((temperature.size,) * 2, np.nan)
    full[np.ix_(data.kept, data.kept)] = reference.covariance
    twice = {
        "temperature": temperature,
        "temperature_2": variable("temperature_2", temperature.values, "degC", "temperature"),
    }
    covariance = xr.DataArray(full, twice, tuple(twice), attrs=described("1", "covariance of log10_aT"))
    return MasterCurve(
        T_ref=T_ref,
        log10_aT=over(log10_aT, "log10 of the horizontal shift factor"),
        u_log10_aT=over(u_log10_aT, "standard uncertainty of log10_aT"),
        covariance=covariance,
        b_T=over(law_b_T, "vertical shift factor"),
        u_b_T=over(law_b_T * u_ln_bT, "standard uncertainty of b_T"),
        level=over(np.exp(levels), "level of the sweep about the vertical law"),
        # A slope that a glass turned out to have is a linear law.
        vertical="linear" if model.vertical == "none" and is_sloped else model.vertical,
        delay=state.delay,
        u_delay=float(u_delay),
        law=chosen,
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


def _laws(found: Superposition, covariance: Floats, T_ref: float) -> dict[str, ShiftLaw]:
    """Fit both laws through the shifts from the reference isotherm, weighed by their covariance."""
    model, shifts, at = found.model, found.fit.state.log10_aT, found.model.reference
    distinct = np.unique(model.temperature).size
    names: tuple[LawName, ...] = ("wlf", "arrhenius") if distinct > 2 else ("arrhenius",)
    differences = covariance - covariance[:, [at]] - covariance[[at]] + covariance[at, at]
    usable = differences if np.any(differences) else np.eye(shifts.size)
    laws: dict[str, ShiftLaw] = {}
    for name in names if distinct > 1 else ():
        law = fit_law(name, model.temperature, shifts - shifts[at], usable, model.T0)
        moved = law.about(T_ref)
        if moved is not None:
            laws[name] = moved
    return laws


def _chosen_law(found: Superposition, laws: dict[str, ShiftLaw], T_ref: float) -> ShiftLaw:
    """Return the law of the fit itself, or the better one through free shifts."""
    model = found.model
    if model.horizontal in ("wlf", "arrhenius"):
        size = model.horizontal_size
        parameters = tuple(float(p) for p in found.fit.state.parameters[:size])
        law = ShiftLaw(model.horizontal, model.T0, parameters, found.covariance[:size, :size]).about(T_ref)
        if law is not None:
            return law
    if not laws:
        return ShiftLaw("arrhenius", T_ref, (0.0,), np.full((1, 1), np.nan))
    # One more constant has to pay for itself (Schwarz).
    price = float(np.log(model.temperature.size))
    return min(laws.values(), key=lambda one: one.chi_square + price * len(one.parameters))
