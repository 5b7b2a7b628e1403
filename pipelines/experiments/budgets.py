"""Main reported quantities of every kind of experiment as formulas of their uncertain inputs.

A formula can be propagated linearly, by Monte Carlo and by Sobol indices
(:mod:`labpipe.propagation`). Repeats enter as type A: the mean's scatter with n − 1 degrees of
freedom, beyond what each repeat states of itself.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import cos, isfinite, pi, sin, sqrt

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.propagation import Model
from labpipe.uncertainty import Input
from pipelines.experiments.indentation import Geometry, elastic_force
from pipelines.settings.plate_vibration import PlateVibration
from pipelines.settings.relaxation import Relaxation
from pipelines.settings.static_loading import StaticLoading

Array = NDArray[np.float64]

_IMPACTS = 3  # the thesis analyses the first three
TESTS = 3
"""Depths or frequencies of an indentation that are shown."""


@dataclass(frozen=True, eq=False)
class Quantity:
    """One reported quantity as a formula of uncertain inputs.

    Attributes
    ----------
    name, unit : str
    model : callable
        Takes every input by its name.
    inputs : dict of str to Input
    """

    name: str
    unit: str
    model: Model
    inputs: dict[str, Input]


def _repeats(values: Array, own: Array) -> tuple[Input, Input]:
    """Return what repeats state of themselves, averaged, and their scatter beyond it."""
    n = values.size
    stated = float(np.sqrt(np.mean(own**2)) / sqrt(n))
    if n < 2:
        return Input(0.0, stated), Input(0.0, 0.0)
    scatter = float(np.std(values, ddof=1) / sqrt(n))
    beyond = sqrt(max(scatter**2 - stated**2, 0.0))
    return Input(0.0, stated), Input(0.0, beyond, degrees_of_freedom=n - 1)


def ball_drop(bounces: Sequence[xr.Dataset], displacement: xr.Dataset) -> Iterator[Quantity]:
    """Yield height of the fall, speed of the first impact, and restitutions of the first ones.

    Parameters
    ----------
    bounces : sequence of Dataset
        Of the repeats.
    displacement : Dataset
        Of the first one.
    """
    made, moved = list(bounces), displacement
    tilt = Input(float(moved["inclination"]), float(moved["u_inclination"]), "rad")
    gain = Input(float(moved["gain"]), float(moved["u_gain"]))
    relative = float(moved.attrs["u_systematic_relative"])
    for name, text, unit in (
        ("drop_height", "height of the fall", "m"),
        ("incoming_speed", "speed of the first impact", "m/s"),
    ):
        values, u = (_first(made, n) for n in (name, f"u_{name}"))
        shape = _pulse_shape(made, name, 0)
        own = np.sqrt(np.maximum(u**2 - (relative * values) ** 2 - shape.u**2, 0.0))
        reading, scatter = _repeats(values, own)
        along = float(values.mean()) * cos(tilt.value) / gain.value
        yield Quantity(
            text, unit,
            lambda reading, gain, inclination, noise, repeatability, pulse_shape: (
                (reading + noise) * gain / cos(inclination) + repeatability + pulse_shape
            ),
            {"reading": Input(along, 0.0, unit), "gain": gain, "inclination": tilt,
             "noise": reading._replace(unit=unit),
             "repeatability": scatter._replace(unit=unit),
             "pulse_shape": shape._replace(unit=unit)},
        )  # fmt: skip
    count = min(_IMPACTS, *(b.sizes["impact"] for b in made))
    for i in range(count):
        values = np.array([float(b["restitution"][i]) for b in made])
        own = np.array([float(b["u_restitution"][i]) for b in made])
        if not np.isfinite(values).all():
            continue
        shape = _pulse_shape(made, "restitution", i)
        noise, scatter = _repeats(values, np.sqrt(np.maximum(own**2 - shape.u**2, 0.0)))
        yield Quantity(
            f"restitution, impact {i + 1}", "1",
            lambda mean, noise, repeatability, pulse_shape: (
                mean + noise + repeatability + pulse_shape
            ),
            {"mean": Input(float(values.mean()), 0.0), "noise": noise, "repeatability": scatter,
             "pulse_shape": shape},
        )  # fmt: skip


def _pulse_shape(made: list[xr.Dataset], name: str, impact: int) -> Input:
    """Return what the unknown shape of the contact's pulse leaves, in all repeats alike."""
    if f"shared_u_{name}" not in made[0]:
        return Input(0.0, 0.0)
    shared = np.array([float(b[f"shared_u_{name}"][impact]) for b in made])
    return Input(0.0, float(np.sqrt(np.mean(shared**2))))


def _first(made: list[xr.Dataset], name: str) -> Array:
    return np.array([float(np.atleast_1d(b[name].values)[0]) for b in made])


def contact_area(impacts: xr.Dataset, film: xr.Dataset) -> Iterator[Quantity]:
    """Yield the largest contact radii of the first impacts."""
    size, u_size = float(film["pixel_size"]), float(film["u_pixel_size"])
    shared = film["radius_systematic"].values / film["radius"].values
    relative = float(np.nanmedian(shared)) if np.isfinite(shared).any() else 0.0
    rest = sqrt(max(relative**2 - (u_size / size) ** 2, 0.0))
    for i in range(min(_IMPACTS, impacts.sizes["impact"])):
        radius, u = float(impacts["peak_radius"][i]), float(impacts["u_peak_radius"][i])
        own = sqrt(max(u**2 - (relative * radius) ** 2, 0.0)) / size
        yield Quantity(
            f"largest contact radius, impact {i + 1}", "m",
            lambda radius, fit, pixel_size, optics: (radius + fit) * pixel_size * optics,
            {"radius": Input(radius / size, 0.0, "px"), "fit": Input(0.0, own, "px"),
             "pixel_size": Input(size, u_size, "m/px"), "optics": Input(1.0, rest)},
        )  # fmt: skip


def relaxation(
    settings: Relaxation, number: int, loads: xr.Dataset, ramps: xr.Dataset, curves: xr.Dataset
) -> Iterator[Quantity]:
    """Yield the relaxed reduced modulus of one test; nothing where it was not found."""
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


def _modulus(
    name: str, loads: xr.Dataset, ramps: xr.Dataset, curves: xr.Dataset, geometry: Geometry
) -> Quantity:
    depth, force = float(ramps["depth"][0]), float(ramps["plateau_force"][0])
    reported = float(curves["reduced_modulus"][0])
    at = np.array([depth])
    whole = _area(at, geometry, {})
    shape = reported / (force / whole)
    tare, gain = float(loads["u_tare"]), float(np.nan_to_num(float(loads["u_gain"])))
    stated = float(loads["gain"])
    u_all = float(ramps["u_plateau_force"][0])
    noise = sqrt(max(u_all**2 - tare**2 - (gain / stated * force) ** 2, 0.0))

    # A contact area goes about as powers of depth and dimensions: one look instead of thousands.
    best = {"tip_radius": geometry.radius.value, "period": geometry.period.value,
            "tip_length": geometry.depth.value}  # fmt: skip
    powers = {n: _power(partial(_with_tip, at, geometry, n)) for n in best}
    by_depth = _power(lambda by: _area(at * by, geometry, {}))

    def model(force: float, tare: float, gain: float, unfinished: float, first_touch: float,
              **tip: float) -> float:  # fmt: skip
        area = (1.0 - first_touch / depth) ** by_depth
        for n, value in tip.items():
            area *= (value / best[n]) ** powers[n]
        return shape * (force * gain - tare - unfinished) / (area * whole)

    return Quantity(name, "Pa", model, {
        "force": Input(force, noise, "N"), "tare": Input(0.0, tare, "N"),
        "gain": Input(1.0, gain / stated), "unfinished": Input(0.0, float(ramps["unfinished"][0]),
                                                             "N"),
        "first_touch": Input(0.0, float(ramps["u_depth"][0]), "m"),
        "tip_radius": Input(geometry.radius.value, geometry.radius.u, "m"),
        "period": Input(geometry.period.value, geometry.period.u, "m"),
        "tip_length": Input(geometry.depth.value, geometry.depth.u, "m"),
    })  # fmt: skip


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
    """Yield the work per cycle at the first frequencies."""
    cell = float(np.nan_to_num(float(loads["u_gain"]))) / float(loads["gain"])
    for i in range(min(TESTS, waves.sizes["oscillation"])):
        at = waves.isel(oscillation=i)
        storage, loss = float(at["storage_stiffness"]), float(at["loss_stiffness"])
        n = float(at["n_cycles"])
        force = float(np.hypot(storage, loss)) * float(at["amplitude"])
        u_force = float(at["u_force_amplitude"])
        noise = sqrt(max(u_force**2 - (cell * force) ** 2, 0.0))
        yield Quantity(
            f"work per cycle at {float(at['frequency']):.3g} Hz", "J",
            lambda force_amplitude, amplitude, phase, gain, cycles: (
                pi * gain * force_amplitude * amplitude * sin(phase) + cycles
            ),
            {"force_amplitude": Input(force, noise, "N"),
             "amplitude": Input(float(at["amplitude"]), float(at["u_amplitude"]), "m"),
             "phase": Input(float(np.arctan2(loss, storage)), float(at["u_phase_lag"]), "rad"),
             "gain": Input(1.0, cell),
             "cycles": Input(0.0, float(at["work_sd"]) / sqrt(n), "J",
                             degrees_of_freedom=max(n - 1.0, 1.0))},
        )  # fmt: skip


def static_loading(
    settings: StaticLoading, displacement: xr.Dataset, steps: xr.Dataset, approach: xr.Dataset
) -> Iterator[Quantity]:
    """Yield the approach and the contact radius under the last load."""
    depth = float(approach["level_approach"][-1])
    u_depth = float(approach["u_level_approach"][-1])
    angle = float(displacement["inclination"])
    gain = Input(1.0, float(displacement["u_gain"]) / float(displacement["gain"]))
    tilt = Input(angle, float(displacement["u_inclination"]), "rad")
    touch = Input(0.0, float(steps["u_touch"]), "m")
    drift = Input(0.0, settings.steps.drift.value, "m")
    shared = depth**2 * (gain.u**2 + (np.tan(angle) * tilt.u) ** 2) + touch.u**2 + drift.u**2
    noise = Input(0.0, sqrt(max(u_depth**2 - shared, 0.0)), "m")

    def moved(reading: float, gain: float, inclination: float, noise: float, drift: float,
              first_touch: float) -> float:  # fmt: skip
        along = (reading * gain) * cos(angle) / cos(inclination)
        return along + noise + drift - first_touch

    inputs = {"reading": Input(depth, 0.0, "m"), "gain": gain, "inclination": tilt,
              "noise": noise, "drift": drift, "first_touch": touch}  # fmt: skip
    yield Quantity("approach under the last load", "m", moved, inputs)
    ball = settings.sphere.radius
    if depth > 0.0:
        yield Quantity(
            "contact radius under the last load", "m",
            lambda radius, **rest: sqrt(max(radius * moved(**rest), 0.0)),
            {"radius": Input(ball.value, ball.u, "m"), **inputs},
        )  # fmt: skip


def plate_vibration(
    settings: PlateVibration, displacement: xr.Dataset, table: xr.Dataset, plate: xr.Dataset
) -> Iterator[Quantity]:
    """Yield natural frequency, damping ratio and modal mass of the plate."""
    for name, text, unit in (
        ("natural_frequency", "natural frequency", "Hz"),
        ("damping_ratio", "damping ratio", "1"),
    ):
        values, own = table[name].values, table[f"u_{name}"].values
        total = float(table[f"u_plate_{name}"])
        stated = float(1.0 / np.sqrt(np.sum(1.0 / own**2)))
        yield Quantity(
            text, unit, lambda mean, noise, repeatability: mean + noise + repeatability,
            {"mean": Input(float(table[f"plate_{name}"]), 0.0, unit),
             "noise": Input(0.0, min(stated, total), unit),
             "repeatability": Input(0.0, sqrt(max(total**2 - stated**2, 0.0)), unit,
                                    max(values.size - 1.0, 1.0))},
        )  # fmt: skip
    mass = float(plate["mass"])
    if settings.sphere is None or not isfinite(mass):
        return
    ball = settings.sphere.mass
    angle = float(displacement["inclination"])
    gain = float(displacement["u_gain"]) / float(displacement["gain"])
    tilt = Input(angle, float(displacement["u_inclination"]), "rad")
    shared = gain**2 + (np.tan(angle) * tilt.u) ** 2 + (ball.u / ball.value) ** 2
    rest = sqrt(max(float(plate["u_mass"]) ** 2 - shared * mass**2, 0.0))
    count = int(np.isfinite(plate["modal_mass"].values).sum())
    yield Quantity(
        "modal mass", "kg",
        lambda mean, gain, inclination, mass_of_sphere, drops: (
            (mean + drops) * mass_of_sphere / ball.value / gain * cos(inclination) / cos(angle)
        ),
        {"mean": Input(mass, 0.0, "kg"), "gain": Input(1.0, gain), "inclination": tilt,
         "mass_of_sphere": Input(ball.value, ball.u, "kg"),
         "drops": Input(0.0, rest, "kg", max(count - 1.0, 1.0))},
    )  # fmt: skip


def dic_validation(motion: xr.Dataset, comparison: xr.Dataset | None) -> Iterator[Quantity]:
    """Yield the largest displacement in the film, and film minus laser where there was one."""
    size = float(motion["pixel_size"])
    moved = motion["displacement"].values
    at = int(np.nanargmax(np.abs(moved)))
    rows = json.loads(motion.attrs["budget"])
    relative = float(motion.attrs["u_systematic_relative"])
    u = float(motion["u_displacement"][at])
    noise = sqrt(max(u**2 - (relative * float(moved[at])) ** 2, 0.0)) / size
    inputs = {"track": Input(float(moved[at]) / size, 0.0, "px"),
              "noise": Input(0.0, noise, "px")}  # fmt: skip
    names = {r["source"].replace(" ", "_"): r for r in rows}
    inputs |= {n: Input(r["value"], r["u"], r["unit"]) for n, r in names.items()}

    def along(track: float, noise: float, **scale: float) -> float:
        changed = sum(r["sensitivity"] * (scale[n] - r["value"]) for n, r in names.items())
        return (track + noise) * (size + changed)

    yield Quantity("largest displacement in the film", "m", along, inputs)
    if comparison is not None and "bias" in comparison and isfinite(float(comparison["u_bias"])):
        yield Quantity(
            "film minus laser", "m", lambda bias, noise: bias + noise,
            {"bias": Input(float(comparison["bias"]), 0.0, "m"),
             "noise": Input(0.0, float(comparison["u_bias"]), "m")},
        )  # fmt: skip


def dma(sweeps: xr.Dataset, master: xr.Dataset, transition: xr.Dataset | None
        ) -> Iterator[Quantity]:  # fmt: skip
    """Yield a shift factor, the modulus after an infinite time, and the peak of the loss."""
    far = int(np.nanargmax(np.abs(master["log10_aT"].values)))
    temperature = float(master["temperature"][far])
    yield Quantity(
        f"log10 a_T at {temperature:.3g} degC", "1", lambda shift, noise: shift + noise,
        {"shift": Input(float(master["log10_aT"][far]), 0.0),
         "noise": Input(0.0, float(master["u_log10_aT"][far]))},
    )  # fmt: skip
    factor = float(sweeps.attrs["u_modulus_factor"])
    noise = json.loads(master.attrs["noise"])
    relative = float(noise["storage"] if isinstance(noise, dict) else noise)
    count = max(int(np.isfinite(sweeps["storage"].values).any(axis=0).sum()), 1)
    yield Quantity(
        "modulus after an infinite time", "Pa",
        lambda modulus, noise, poisson_ratio: modulus * noise * poisson_ratio,
        {"modulus": Input(float(master["E_relaxed"]), 0.0, "Pa"),
         "noise": Input(1.0, relative / sqrt(count)), "poisson_ratio": Input(1.0, factor)},
    )  # fmt: skip
    if transition is None or "T_peak" not in transition:
        return
    peak, u_peak = float(transition["T_peak"][0]), float(transition["u_T_peak"][0])
    if isfinite(peak) and isfinite(u_peak):
        yield Quantity(
            "temperature of the loss peak", "degC", lambda peak, noise: peak + noise,
            {"peak": Input(peak, 0.0, "degC"), "noise": Input(0.0, u_peak, "K")},
        )  # fmt: skip
