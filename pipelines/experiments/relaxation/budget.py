"""Budgets of a relaxation: relaxed modulus, and peak of the force."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from math import isfinite

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.uncertainty import Input, excess_uncertainty
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared.budget_quantity import MEASURED, NOTHING_FALLS, TESTS, Quantity
from pipelines.experiments.shared.punch_model import Geometry, elastic_force
from pipelines.experiments.shared.ramps_and_holds import relative_gain

_ON_MODULUS = (
    ("sampling", "plateau and first touch are fitted to many readings: included in their noise"),
    ("Poisson's ratio", "the reduced modulus includes it; for a bonded sheet it is taken as exact"),
    ("temperature", "the rubber was measured at its temperature; it affects the model"),
    ("repeatability", "one test per depth; the mean modulus compares the depths"),
)
_ON_PEAK = (
    ("zero of the depth, radius, Poisson's ratio, temperature", "a force was measured; they affect the model"),
    ("sampling", "the fitted force interpolates between the readings"),
    ("repeatability", "one test per depth"),
)


def quantities(
    loads: Sequence[xr.Dataset], ramps: Sequence[xr.Dataset], curves: Sequence[xr.Dataset], *, settings: Relaxation
) -> Iterator[Quantity]:
    """Yield relaxed reduced modulus and peak of the first tests."""
    for number, parts in enumerate(zip(loads[:TESTS], ramps, curves, strict=False)):
        yield from _of_test(settings, number, *parts)


def _of_test(
    settings: Relaxation, number: int, loads: xr.Dataset, ramps: xr.Dataset, curves: xr.Dataset
) -> Iterator[Quantity]:
    """Yield the relaxed reduced modulus and the peak of one test; nothing that was not found."""
    if settings.punch is None or "reduced_modulus" not in curves:
        return
    nu = float(curves["nu"])
    geometry = Geometry.of(settings.punch, settings.substrate, settings.model, nu if isfinite(nu) else None)
    if geometry.model.profile == "circle" or isfinite(geometry.thickness):
        # boundary elements take seconds: the parabola's sensitivities differ by a per cent of it
        closed = type(geometry.model)(profile="parabola")
        geometry = Geometry.of(settings.punch, None, closed, None)
    yield _modulus(f"relaxed reduced modulus, test {number + 1}", loads, ramps, curves, geometry)
    if "peak_filter_part" in curves:
        yield _peak(f"largest force before the filter, test {number + 1}", loads, curves)


def _modulus(name: str, loads: xr.Dataset, ramps: xr.Dataset, curves: xr.Dataset, geometry: Geometry) -> Quantity:
    depth, force = float(ramps["depth"][0]), float(ramps["plateau_force"][0])
    reported = float(curves["reduced_modulus"][0])
    at = np.array([depth])
    whole = _area(at, geometry, {})
    shape = reported / (force / whole)
    gain, tare, lag = relative_gain(loads), float(loads["u_tare"]), float(ramps["u_plateau_lag"][0])
    noise = excess_uncertainty(float(ramps["u_plateau_force"][0]), tare, gain * force, lag)
    touch = float(ramps["u_contact_position"])
    # A contact area goes about as powers of depth and dimensions: one look instead of thousands.
    best = {"tip_radius": geometry.radius.value, "period": geometry.period.value, "tip_length": geometry.depth.value}
    powers = {n: _power(partial(_with_tip, at, geometry, n)) for n in best}
    by_depth = _power(lambda by: _area(at * by, geometry, {}))

    def model(
        measured: float,
        noise: float,
        tare: float,
        gain: float,
        unfinished: float,
        filter_lag: float,
        first_touch: float,
        stage: float,
        **tip: float,
    ) -> float:
        area = (1.0 - (first_touch + stage) / depth) ** by_depth
        for n, value in tip.items():
            area *= (value / best[n]) ** powers[n]
        return shape * ((measured + noise - filter_lag) * gain - tare - unfinished) / (area * whole)

    return Quantity(
        name,
        "Pa",
        model,
        {
            MEASURED: Input(force, 0.0, "N"),
            "noise": Input(0.0, noise, "N"),
            "tare": Input(0.0, tare, "N"),
            "gain": Input(1.0, gain),
            "unfinished": Input(0.0, float(ramps["unfinished"][0]), "N"),
            "filter_lag": Input(0.0, lag, "N"),
            "first_touch": Input(0.0, touch, "m"),
            "stage": Input(0.0, excess_uncertainty(float(ramps["u_depth"][0]), touch), "m"),
            "tip_radius": Input(geometry.radius.value, geometry.radius.u, "m"),
            "period": Input(geometry.period.value, geometry.period.u, "m"),
            "tip_length": Input(geometry.depth.value, geometry.depth.u, "m"),
        },
        (*NOTHING_FALLS, *_ON_MODULUS),
        "relaxed reduced modulus",
    )


def _peak(name: str, loads: xr.Dataset, curves: xr.Dataset) -> Quantity:
    force = float(curves["peak_force_unfiltered"][0])
    gain, tare = relative_gain(loads), float(loads["u_tare"])
    lag = float(curves["peak_filter_part"][0])
    noise = excess_uncertainty(float(curves["u_peak_force_unfiltered"][0]), tare, gain * force, lag)
    return Quantity(
        name,
        "N",
        lambda measured, noise, tare, gain, filter_lag: (measured + noise) * gain - tare - filter_lag,
        {
            MEASURED: Input(force, 0.0, "N"),
            "noise": Input(0.0, noise, "N"),
            "tare": Input(0.0, tare, "N"),
            "gain": Input(1.0, gain),
            "filter_lag": Input(0.0, lag, "N"),
        },
        (*NOTHING_FALLS, *_ON_PEAK),
        "largest force before the filter",
    )


_STEP = 1e-3  # relative, by which powers are found


def _power(area: Callable[[float], float]) -> float:
    """Return d ln(area) / d ln(input) from the area at an input times a factor."""
    return float(np.log(area(1.0 + _STEP) / area(1.0 - _STEP)) / np.log((1 + _STEP) / (1 - _STEP)))


def _with_tip(at: Floats, geometry: Geometry, name: str, by: float) -> float:
    return _area(at, geometry, {name: by})


def _area(at: Floats, geometry: Geometry, by: dict[str, float]) -> float:
    """Return the elastic force over reduced modulus, with dimensions of the tip changed."""
    given = {"tip_radius": geometry.radius, "period": geometry.period, "tip_length": geometry.depth}
    keys = {"tip_radius": "radius", "period": "period", "tip_length": "depth"}
    sizes = {name: size.value * by.get(keys[name], 1.0) for name, size in given.items()}
    return float(elastic_force(at, geometry, **sizes)[0])
