"""Time–temperature superposition: error of the shifts against run time, on two known materials.

The sweeps are computed without any formula of the analysis. Peer: the procedure of RepTate, which has no interface
without windows and is written out here.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from scipy.optimize import minimize

from labpipe.arrays import Floats
from labpipe.materials import MasterCurve, master_curve
from labpipe.report import SURE
from pipelines.bench.measure import Extra, Suite, race
from pipelines.rig.solids import Element, Solid

_PROCEDURE = "RepTate's procedure"
_DEFAULT = "free shifts"


def run(quick: bool) -> list[Suite]:
    """Measure settings and peers on two materials: mean errors over the seeds, and how often the bars hold."""
    return [
        _compared("master-curve", "twenty Maxwell terms, WLF", MAXWELL, quick),
        _compared("master-curve-fractional", "two fractional elements, kinked law", FRACTIONAL, quick),
    ]


def _compared(name: str, words: str, truth: Solid, quick: bool) -> Suite:
    sets = [measured(truth, 700 + seed) for seed in range(2 if quick else 10)]
    settings: dict[str, dict[str, Any]] = {
        _DEFAULT: {},
        "free shifts, laws asked for": {"vertical": "linear", "delay": True},
        "free shifts, no laws tried": {"vertical": "none", "delay": False},
        **({"WLF inside the fit": {"law": "wlf"}} if truth is MAXWELL else {}),
    }
    methods: dict[str, tuple[str, Callable[[Measured], Any]]] = {
        label: ("", partial(_ours, **options)) for label, options in settings.items()
    }
    for label, is_vertical in () if quick else (("horizontal", False), ("horizontal and vertical", True)):
        methods[f"{_PROCEDURE}, {label}"] = _PROCEDURE, partial(pairwise_shifts, is_vertical=is_vertical)
    calls = {label: (group, partial(method, sets[0])) for label, (group, method) in methods.items()}

    def judge(label: str, first: Any) -> tuple[float, Extra]:
        found: list[Any] = [first, *(methods[label][1](made) for made in sets[1:])]
        shifts = [one.log10_aT.values if isinstance(one, MasterCurve) else one for one in found]
        errors = [made.error(one) for made, one in zip(sets, shifts, strict=True)]
        extra: dict[str, float] = {"worst (decades)": float(np.max(errors))}
        if isinstance(found[0], MasterCurve):
            pairs = [(one, made, made.log10_aT != 0.0) for made, one in zip(sets, found, strict=True)]
            off = [np.abs(one.log10_aT.values - made.log10_aT)[others] for one, made, others in pairs]
            reach = [SURE * one.u_log10_aT.values[others] for one, _, others in pairs]
            extra["95 % bars that hold (%)"] = 100.0 * float(np.mean(np.concatenate(off) <= np.concatenate(reach)))
        return float(np.mean(errors)), extra

    points = race(calls, 2 if quick else 5, judge, _DEFAULT, budget=20.0)
    notes = [f"mean over {len(sets)} seeds; 12 temperatures, 11 points each, 2 % noise"]
    notes += ["RepTate's procedure is left out of the quick run"] if quick else []
    return Suite(name, f"Shifts of {words}", "RMS error of log10 a_T (decades)", points, notes=notes)


def _ours(made: "Measured", **options: Any) -> MasterCurve:
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        return master_curve(made.sweeps, T_ref=made.reference, **options)


@dataclass(frozen=True, slots=True)
class Measured:
    """One set of sweeps and what is true of it.

    ``sweeps``; ``reference`` [degC]: the isotherm that errors are counted from; ``log10_aT`` (temperature,): true
    shifts from that isotherm.
    """

    sweeps: xr.Dataset
    reference: float
    log10_aT: Floats

    def error(self, log10_aT: Floats) -> float:
        """Root-mean-square error of shifts counted from any isotherm (decades)."""
        at = int(np.argmin(np.abs(self.sweeps["temperature"].values - self.reference)))
        return float(np.sqrt(np.mean((log10_aT - log10_aT[at] - self.log10_aT) ** 2)))


def measured(truth: Solid, seed: int, temperatures: int = 12, noise: float = 0.02, points: int = 11) -> Measured:
    """Measure a material from −40 to 120 °C at 0.1 to 10 Hz, relative noise on both moduli."""
    rng = np.random.default_rng(seed)
    temperature, frequency = np.linspace(-40.0, 120.0, temperatures), np.logspace(-1.0, 1.0, points)
    at, law = int(np.argmin(np.abs(temperature - truth.T_ref))), truth.log10_aT(temperature)
    exact = truth.modulus(frequency, temperature[:, None])
    dims = ("temperature", "frequency")
    sweeps = xr.Dataset(
        {
            name: (dims, part * (1.0 + noise * rng.standard_normal(exact.shape)), {"units": "Pa"})
            for name, part in (("storage", exact.real), ("loss", exact.imag))
        },
        coords={
            "temperature": ("temperature", temperature, {"units": "degC"}),
            "frequency": ("frequency", frequency, {"units": "Hz"}),
        },
    )
    return Measured(sweeps, float(temperature[at]), law - law[at])


def _maxwell() -> Solid:
    """Twenty terms, 1e-10 to 1e2 s, 8 MPa to 3 GPa, two loss peaks; WLF with 15 and 250 K about 40 °C."""
    rho = np.logspace(-10.0, 2.0, 20)
    x = np.log10(rho)
    weight = np.exp(-0.5 * ((x + 6.0) / 1.6) ** 2)
    weight = weight + 0.12 * np.exp(-0.5 * ((x + 0.5) / 1.1) ** 2) + 0.004
    terms = map(Element, (weight / weight.sum() * (3e9 - 8e6)).tolist(), rho.tolist())
    return Solid(tuple(terms), 8e6, 0.4, kink=-60.0, C1=25.0, C2=150.0, T_ref=60.0)


MAXWELL = _maxwell()
FRACTIONAL = Solid(
    (Element(1.9e9, 3e-5, 0.32), Element(7e8, 0.2, 0.55)),
    12e6,
    0.4,
    energy=150e3,
    kink=30.0,
    C1=11.0,
    C2=130.0,
    T_ref=40.0,
)
"""No sum of exponentials; Arrhenius below 30 °C, WLF above."""


def pairwise_shifts(made: Measured, is_vertical: bool) -> Floats:
    """Shift one isotherm after the other, nearest to the reference first, onto a table that grows.

    Both moduli count by the mean square of the distances of their logarithms over the frequencies
    that an isotherm shares with the table; the simplex of Nelder and Mead moves it. Returned is
    log10 a (temperature,), zero at the reference.
    """
    temperature = made.sweeps["temperature"].values
    x = np.log10(made.sweeps["frequency"].values)
    moduli = np.stack([np.log10(made.sweeps[name].values) for name in ("storage", "loss")], axis=1)
    order = np.argsort(np.abs(temperature - made.reference), kind="stable")
    shifts = np.zeros(temperature.size)
    table_x, table_y = x.copy(), moduli[order[0]].copy()
    for k in order[1:]:
        nearest = order[: list(order).index(k)]
        start = shifts[nearest[np.argmin(np.abs(temperature[nearest] - temperature[k]))]]
        moved = partial(_distance, table_x, table_y, x, moduli[k])
        size = 2 if is_vertical else 1
        simplex = np.vstack([np.zeros(size), 0.5 * np.eye(size)]) + np.array([start, 0.0])[:size]
        best = minimize(moved, simplex[0], method="Nelder-Mead", options={"initial_simplex": simplex}).x
        shifts[k] = best[0]
        table_x = np.concatenate([table_x, x + best[0]])
        table_y = np.concatenate([table_y, moduli[k] - (best[1] if is_vertical else 0.0)], axis=1)
        by = np.argsort(table_x, kind="stable")
        table_x, table_y = table_x[by], table_y[:, by]
    return shifts


def _distance(
    table_x: Floats, table_y: Floats, x: Floats, y: Floats, move: Floats, least: float = 0.05, apart: float = 1e3
) -> float:
    """Return the mean squared distance of a moved isotherm from the table, in decades squared.

    An isotherm that shares less than ``least`` decades with the table is ``apart``.
    """
    at = x + move[0]
    inside = (at >= table_x[0]) & (at <= table_x[-1])
    if not inside.any() or np.ptp(at[inside]) < least:
        return apart + float(np.min(np.abs(at[:, None] - table_x)))
    down = move[1] if move.size > 1 else 0.0
    rest = [(row[inside] - down) - np.interp(at[inside], table_x, known) for row, known in zip(y, table_y, strict=True)]
    return float(np.mean(np.square(rest)))
