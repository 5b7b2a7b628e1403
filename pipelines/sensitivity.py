"""Uncertainty budgets of the main reported quantities, and which input limits each of them.

Every quantity is a formula of its inputs, so that it can be propagated linearly, by Monte Carlo
and by Sobol indices (:mod:`labpipe.propagation`). Repeats enter as type A: the mean's scatter with
n − 1 degrees of freedom, beyond what each repeat states of itself.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import cos, isfinite, pi, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from labpipe.errors import InputError, UsageError
from labpipe.propagation import Indices, Model, MonteCarlo, agrees, linear, monte_carlo, sobol
from labpipe.uncertainty import Budget, Input
from labpipe.workflow.session import Experiment, Session
from pipelines import process
from pipelines.experiments.indentation import Geometry, elastic_force
from pipelines.experiments.material import resolve

_IMPACTS = 3  # the thesis analyses the first three
_TESTS = 3  # depths or frequencies of an indentation that are shown


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


@dataclass(frozen=True, eq=False)
class Examined:
    """A quantity with its budget, checked.

    Attributes
    ----------
    experiment : str
    quantity : Quantity
    budget : Budget
        Linear.
    drawn : MonteCarlo
    is_linear : bool
        The linear 95 % interval agrees with the drawn one.
    indices : dict of str to Indices
        Sobol's.
    """

    experiment: str
    quantity: Quantity
    budget: Budget
    drawn: MonteCarlo
    is_linear: bool
    indices: dict[str, Indices]

    @property
    def coverage_factor(self) -> float:
        """Expanded over standard uncertainty, for 95 %."""
        return self.budget.expanded() / self.budget.u if self.budget.u else float("nan")


def examine(folder: str | Path, wanted: str | None = None) -> list[Examined]:
    """Examine the main quantities of every experiment of a session.

    Parameters
    ----------
    folder : path-like
        The session folder; what is not processed yet is processed first.
    wanted : str, optional
        Only experiments of this kind, or of this name.

    Returns
    -------
    list of Examined

    Raises
    ------
    UsageError
        There is no such kind or experiment with budgets.
    InputError
        A step before failed.
    """
    session = process.open_session(folder)
    chosen = [
        e for n, e in session.experiments.items()
        if e.kind in QUANTITIES and wanted in (None, n, e.kind)
    ]  # fmt: skip
    if not chosen:
        kinds = ", ".join(QUANTITIES)
        message = (
            f'nothing to examine for "{wanted or "this session"}"; kinds with budgets: {kinds}'
        )
        raise UsageError(message)
    targets = [f"{e.name}/{s}" for e in chosen for s in QUANTITIES[e.kind][0]]
    run = process.process(folder, targets, [e.name for e in chosen])
    for outcome in run.failures:
        message = f"{outcome.task}: {outcome.message}"
        raise InputError(message)
    return [
        examined(e.name, quantity) for e in chosen for quantity in QUANTITIES[e.kind][1](session, e)
    ]


def examined(experiment: str, quantity: Quantity) -> Examined:
    """Propagate one quantity in all three ways."""
    budget = linear(quantity.model, quantity.inputs)
    drawn = monte_carlo(quantity.model, quantity.inputs)
    return Examined(
        experiment, quantity, budget, drawn, agrees(budget, drawn),
        sobol(quantity.model, quantity.inputs),
    )  # fmt: skip


def _repeats(values: np.ndarray, own: np.ndarray) -> tuple[Input, Input]:
    """Return what repeats state of themselves, averaged, and their scatter beyond it."""
    n = values.size
    stated = float(np.sqrt(np.mean(own**2)) / sqrt(n))
    if n < 2:
        return Input(0.0, stated), Input(0.0, 0.0)
    scatter = float(np.std(values, ddof=1) / sqrt(n))
    beyond = sqrt(max(scatter**2 - stated**2, 0.0))
    return Input(0.0, stated), Input(0.0, beyond, degrees_of_freedom=n - 1)


def _ball_drop(session: Session, experiment: Experiment) -> Iterator[Quantity]:
    settings: Any = experiment.settings
    made = [process.result(session.root, experiment.name, "bounces", f) for f in settings.laser]
    moved = process.result(session.root, experiment.name, "displacement", settings.laser[0])
    tilt = Input(float(moved["inclination"]), float(moved["u_inclination"]), "rad")
    gain = Input(float(moved["gain"]), float(moved["u_gain"]))
    relative = float(moved.attrs["u_systematic_relative"])
    for name, text, unit in (
        ("drop_height", "height of the fall", "m"),
        ("incoming_speed", "speed of the first impact", "m/s"),
    ):
        values, u = (_first(made, n) for n in (name, f"u_{name}"))
        own = np.sqrt(np.maximum(u**2 - (relative * values) ** 2, 0.0))
        reading, scatter = _repeats(values, own)
        along = float(values.mean()) * cos(tilt.value) / gain.value
        yield Quantity(
            text, unit,
            lambda reading, gain, inclination, noise, repeatability: (
                (reading + noise) * gain / cos(inclination) + repeatability
            ),
            {"reading": Input(along, 0.0, unit), "gain": gain, "inclination": tilt,
             "noise": reading._replace(unit=unit),
             "repeatability": scatter._replace(unit=unit)},
        )  # fmt: skip
    count = min(_IMPACTS, *(b.sizes["impact"] for b in made))
    for i in range(count):
        values = np.array([float(b["restitution"][i]) for b in made])
        own = np.array([float(b["u_restitution"][i]) for b in made])
        if not np.isfinite(values).all():
            continue
        noise, scatter = _repeats(values, own)
        yield Quantity(
            f"restitution, impact {i + 1}", "1",
            lambda mean, noise, repeatability: mean + noise + repeatability,
            {"mean": Input(float(values.mean()), 0.0), "noise": noise, "repeatability": scatter},
        )  # fmt: skip


def _first(made: list[xr.Dataset], name: str) -> np.ndarray:
    return np.array([float(np.atleast_1d(b[name].values)[0]) for b in made])


def _contact_area(session: Session, experiment: Experiment) -> Iterator[Quantity]:
    impacts = process.result(session.root, experiment.name, "impacts")
    film = process.result(session.root, experiment.name, "radius")
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


def _relaxation(session: Session, experiment: Experiment) -> Iterator[Quantity]:
    settings: Any = experiment.settings
    if settings.punch is None:
        return
    nu = None
    if settings.substrate is not None and settings.substrate.material is not None:
        nu = float(resolve(settings.substrate, None, None).nu)
    geometry = Geometry.of(settings.punch, settings.substrate, settings.model, nu)
    if geometry.model.profile == "circle" or isfinite(geometry.thickness):
        # boundary elements take seconds: the parabola's sensitivities differ by a per cent of it
        closed = type(geometry.model)(profile="parabola")
        geometry = Geometry.of(settings.punch, None, closed, nu)
    for number, file in enumerate(settings.mach1[:_TESTS]):
        loads, ramps, curves = (
            process.result(session.root, experiment.name, stage, file)
            for stage in ("loads", "ramps", "curves")
        )
        if "reduced_modulus" not in curves:
            continue
        yield _modulus(f"relaxed reduced modulus, test {number + 1}", loads, ramps, curves,
                       geometry)  # fmt: skip


def _modulus(
    name: str, loads: xr.Dataset, ramps: xr.Dataset, curves: xr.Dataset, geometry: Geometry
) -> Quantity:
    depth, force = float(ramps["depth"][0]), float(ramps["plateau_force"][0])
    reported = float(curves["reduced_modulus"][0])
    at = np.array([depth])
    shape = reported / (force / float(elastic_force(at, geometry)[0]))
    tare, gain = float(loads["u_tare"]), float(np.nan_to_num(float(loads["u_gain"])))
    best = float(loads["gain"])
    u_all = float(ramps["u_plateau_force"][0])
    noise = sqrt(max(u_all**2 - tare**2 - (gain / best * force) ** 2, 0.0))

    def model(force: float, tare: float, gain: float, unfinished: float, first_touch: float,
              tip_radius: float, period: float, tip_length: float) -> float:  # fmt: skip
        area = elastic_force(at - first_touch, geometry, radius=tip_radius, period=period,
                             depth=tip_length)  # fmt: skip
        return shape * (force * gain - tare - unfinished) / float(area[0])

    return Quantity(name, "Pa", model, {
        "force": Input(force, noise, "N"), "tare": Input(0.0, tare, "N"),
        "gain": Input(1.0, gain / best), "unfinished": Input(0.0, float(ramps["unfinished"][0]),
                                                             "N"),
        "first_touch": Input(0.0, float(ramps["u_depth"][0]), "m"),
        "tip_radius": Input(geometry.radius.value, geometry.radius.u, "m"),
        "period": Input(geometry.period.value, geometry.period.u, "m"),
        "tip_length": Input(geometry.depth.value, geometry.depth.u, "m"),
    })  # fmt: skip


def _harmonic(session: Session, experiment: Experiment) -> Iterator[Quantity]:
    waves = process.result(session.root, experiment.name, "oscillations")
    loads = process.result(session.root, experiment.name, "loads")
    cell = float(np.nan_to_num(float(loads["u_gain"]))) / float(loads["gain"])
    for i in range(min(_TESTS, waves.sizes["oscillation"])):
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


QUANTITIES: dict[
    str, tuple[tuple[str, ...], Callable[[Session, Experiment], Iterator[Quantity]]]
] = {
    "ball_drop": (("bounces", "displacement"), _ball_drop),
    "contact_area": (("radius", "impacts"), _contact_area),
    "relaxation": (("loads", "ramps", "curves"), _relaxation),
    "harmonic": (("loads", "oscillations"), _harmonic),
}
"""What of each kind is read, and its main quantities."""
