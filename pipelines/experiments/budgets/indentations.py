"""Budgets of the indentations: relaxed modulus and peak of a relaxation, stiffness and work."""

from collections.abc import Callable, Iterator
from functools import partial
from math import cos, isfinite, pi, sin

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input, beyond
from pipelines.experiments import mach1_file
from pipelines.experiments.budgets.quantity import (
    MEASURED,
    TESTS,
    Array,
    Quantity,
)
from pipelines.experiments.indentation import Geometry, elastic_force
from pipelines.settings.relaxation import Relaxation

_ABSENT = (
    ("inclination, pixel size, mass, height", "there is no laser, no camera, and nothing falls"),
)
_ON_MODULUS = (
    ("sampling", "a plateau and the first touch are fitted to many readings: in their noise"),
    ("Poisson's ratio", "a reduced modulus holds it; of a bonded sheet it is taken as exact"),
    ("temperature", "what the rubber is at its temperature was measured; it acts on the model"),
    ("repeatability", "one test for each depth; the depths are compared in the moduli's mean"),
)  # fmt: skip
_ON_PEAK = (
    ("zero of the depth, radius, Poisson's ratio, temperature",
     "a force was measured; they act on the model"),
    ("sampling", "the fitted force runs between the readings"),
    ("repeatability", "one test for each depth"),
)  # fmt: skip
_ON_CYCLES = (
    ("zero", "a tare and a place of first touch do not oscillate"),
    ("sampling", "all readings of all cycles are fitted, and their rounding is in the noise"),
    ("radius, Poisson's ratio, temperature",
     "what the rubber does at its temperature was measured; they act on model and theory"),
)  # fmt: skip


def relaxation(
    settings: Relaxation, number: int, loads: xr.Dataset, ramps: xr.Dataset, curves: xr.Dataset
) -> Iterator[Quantity]:
    """Yield the relaxed reduced modulus and the peak of one test; nothing that was not found."""
    if settings.punch is None or "reduced_modulus" not in curves:
        return
    nu = float(curves["nu"])
    geometry = Geometry.of(settings.punch, settings.substrate, settings.model,
                           nu if isfinite(nu) else None)  # fmt: skip
    if geometry.model.profile == "circle" or isfinite(geometry.thickness):
        # boundary elements take seconds: the parabola's sensitivities differ by a per cent of it
        closed = type(geometry.model)(profile="parabola")
        geometry = Geometry.of(settings.punch, None, closed, None)
    yield _modulus(f"relaxed reduced modulus, test {number + 1}", loads, ramps, curves, geometry)
    if "peak_filter_part" in curves:
        yield _peak(f"largest force before the filter, test {number + 1}", loads, curves)


def _modulus(
    name: str, loads: xr.Dataset, ramps: xr.Dataset, curves: xr.Dataset, geometry: Geometry
) -> Quantity:
    depth, force = float(ramps["depth"][0]), float(ramps["plateau_force"][0])
    reported = float(curves["reduced_modulus"][0])
    at = np.array([depth])
    whole = _area(at, geometry, {})
    shape = reported / (force / whole)
    gain, tare, lag = _gain(loads), float(loads["u_tare"]), float(ramps["u_plateau_lag"][0])
    noise = beyond(float(ramps["u_plateau_force"][0]), tare, gain * force, lag)
    touch = float(ramps["u_contact_position"])
    # A contact area goes about as powers of depth and dimensions: one look instead of thousands.
    best = {"tip_radius": geometry.radius.value, "period": geometry.period.value,
            "tip_length": geometry.depth.value}  # fmt: skip
    powers = {n: _power(partial(_with_tip, at, geometry, n)) for n in best}
    by_depth = _power(lambda by: _area(at * by, geometry, {}))

    def model(
        measured: float, noise: float, tare: float, gain: float, unfinished: float,
        filter_lag: float, first_touch: float, stage: float, **tip: float,
    ) -> float:  # fmt: skip
        area = (1.0 - (first_touch + stage) / depth) ** by_depth
        for n, value in tip.items():
            area *= (value / best[n]) ** powers[n]
        return shape * ((measured + noise - filter_lag) * gain - tare - unfinished) / (area * whole)

    return Quantity(name, "Pa", model, {
        MEASURED: Input(force, 0.0, "N"), "noise": Input(0.0, noise, "N"),
        "tare": Input(0.0, tare, "N"), "gain": Input(1.0, gain),
        "unfinished": Input(0.0, float(ramps["unfinished"][0]), "N"),
        "filter_lag": Input(0.0, lag, "N"), "first_touch": Input(0.0, touch, "m"),
        "stage": Input(0.0, beyond(float(ramps["u_depth"][0]), touch), "m"),
        "tip_radius": Input(geometry.radius.value, geometry.radius.u, "m"),
        "period": Input(geometry.period.value, geometry.period.u, "m"),
        "tip_length": Input(geometry.depth.value, geometry.depth.u, "m"),
    }, (*_ABSENT, *_ON_MODULUS), "relaxed reduced modulus")  # fmt: skip


def _peak(name: str, loads: xr.Dataset, curves: xr.Dataset) -> Quantity:
    force = float(curves["peak_force_unfiltered"][0])
    gain, tare = _gain(loads), float(loads["u_tare"])
    lag = float(curves["peak_filter_part"][0])
    noise = beyond(float(curves["u_peak_force_unfiltered"][0]), tare, gain * force, lag)
    return Quantity(
        name, "N",
        lambda measured, noise, tare, gain, filter_lag: (
            (measured + noise) * gain - tare - filter_lag
        ),
        {MEASURED: Input(force, 0.0, "N"), "noise": Input(0.0, noise, "N"),
         "tare": Input(0.0, tare, "N"), "gain": Input(1.0, gain),
         "filter_lag": Input(0.0, lag, "N")},
        (*_ABSENT, *_ON_PEAK), "largest force before the filter",
    )  # fmt: skip


def _gain(loads: xr.Dataset) -> float:
    """Return the relative uncertainty of the cell's gain; one that nobody knows adds nothing."""
    return float(np.nan_to_num(float(loads["u_gain"]))) / float(loads["gain"])


_STEP = 1e-3  # relative, by which powers are found


def _power(area: Callable[[float], float]) -> float:
    """Return d ln(area) / d ln(input) from the area at an input times a factor."""
    return float(np.log(area(1.0 + _STEP) / area(1.0 - _STEP)) / np.log((1 + _STEP) / (1 - _STEP)))


def _with_tip(at: Array, geometry: Geometry, name: str, by: float) -> float:
    return _area(at, geometry, {name: by})


def _area(at: Array, geometry: Geometry, by: dict[str, float]) -> float:
    """Return the elastic force over reduced modulus, with dimensions of the tip changed."""
    sizes = {
        name: given.value * by.get(key, 1.0)
        for key, name, given in (
            ("tip_radius", "radius", geometry.radius), ("period", "period", geometry.period),
            ("tip_length", "depth", geometry.depth),
        )
    }  # fmt: skip
    return float(elastic_force(at, geometry, **sizes)[0])


def harmonic(waves: xr.Dataset, loads: xr.Dataset) -> Iterator[Quantity]:
    """Yield storage stiffness and work per cycle at the first frequencies."""
    for i in range(min(TESTS, waves.sizes["oscillation"])):
        at = waves.isel(oscillation=i)
        where = f"at {float(at['frequency']):.3g} Hz"
        inputs, scatter = _of_cycle(at, loads, bool(waves.attrs["is_filter_corrected"]))
        yield Quantity(
            f"storage stiffness {where}", "N/m", _stiffness, inputs,
            (*_ABSENT, *_ON_CYCLES, ("repeatability", "cycles are fitted as one: in the noise")),
            "storage stiffness",
        )  # fmt: skip
        yield Quantity(
            f"work per cycle {where}", "J", _work,
            inputs | {"repeatability": scatter}, (*_ABSENT, *_ON_CYCLES), "work per cycle",
        )  # fmt: skip


def _of_cycle(
    at: xr.Dataset, loads: xr.Dataset, is_corrected: bool
) -> tuple[dict[str, Input], Input]:
    """Return what one oscillation hangs on, and the scatter of its loops."""
    storage, loss = float(at["storage_stiffness"]), float(at["loss_stiffness"])
    amplitude, n = float(at["amplitude"]), float(at["n_cycles"])
    force = float(np.hypot(storage, loss)) * amplitude
    lag = mach1_file.force_lag(loads, float(at["frequency"])) if is_corrected else None
    of_filter = (0.0, 0.0) if lag is None else (lag.u_gain / lag.gain, lag.u_phase)
    cell = _gain(loads)
    noise = beyond(float(at["u_force_amplitude"]), cell * force, of_filter[0] * force)
    return {
        "force_amplitude": Input(force, noise, "N"),
        "amplitude": Input(amplitude, float(at["u_amplitude"]), "m"),
        "phase": Input(float(np.arctan2(loss, storage)),
                       beyond(float(at["u_phase_lag"]), of_filter[1]), "rad"),
        "filter_lag": Input(0.0, of_filter[1], "rad"),
        "filter_gain": Input(1.0, of_filter[0]), "gain": Input(1.0, cell),
    }, Input(0.0, float(at["work_sd"]) / np.sqrt(n), "J",
             degrees_of_freedom=max(n - 1.0, 1.0))  # fmt: skip


def _stiffness(
    force_amplitude: float, amplitude: float, phase: float, filter_lag: float, filter_gain: float,
    gain: float,
) -> float:  # fmt: skip
    return gain * force_amplitude / filter_gain / amplitude * cos(phase + filter_lag)


def _work(
    force_amplitude: float, amplitude: float, phase: float, filter_lag: float, filter_gain: float,
    gain: float, repeatability: float,
) -> float:  # fmt: skip
    pushed = gain * force_amplitude / filter_gain
    return pi * pushed * amplitude * sin(phase + filter_lag) + repeatability
