"""How the results of each kind of experiment become evidence on its material."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe import contact
from labpipe.errors import InputError, UsageError
from labpipe.identification import (
    Bounces,
    DropModel,
    Evidence,
    Parameter,
    drop_evidence,
    force_evidence,
    lee_radok_basis,
    modulus_evidence,
    stiffness_evidence,
)
from labpipe.materials import Prony
from labpipe.signals import common_fit
from labpipe.uncertainty import combined
from labpipe.workflow.session import Experiment, Session
from pipelines.experiments import holds, mach1_file
from pipelines.experiments.indentation import Geometry, elastic_force, relative_sources
from pipelines.experiments.material import resolve
from pipelines.experiments.plate import plate_inputs, resolve_plate
from pipelines.experiments.relaxation import elastic_area
from pipelines.figures.inputs import Inputs, referred

Array = NDArray[np.float64]

_DELAYS = 20.0  # time constants of the cell's filter after which it leaves a relaxation as it is
_SHIFT = 1e-7  # m of first touch by which a derivative is found
_LEAST_RELATIVE = 5e-4  # of a radius
_LEAST_OF_STIFFNESS = 2e-4  # of its size: how well simulated oscillations agree with closed forms
_LEAST_OF_FORCE = 1e-5  # of a force in a hold: what chords of histories are good for
_LEAST_OF_TIME = 5e-5  # of a time of touch: what simulated and recorded clocks are good for
_SPECIMEN = 0.05  # relative: what a rheometer's clamp and the specimen's size leave uncertain
_PER_DECADE = 2  # frequencies of the rheometer's moduli
_LEAST_NOISE = (0.01, 0.03)  # relative, of its storage and loss modulus


@dataclass(frozen=True, eq=False)
class Proof:
    """One experiment, ready to become evidence once the relaxation times are chosen.

    Attributes
    ----------
    material : str
    nu : float
    window : tuple of float [s]
        Shortest and longest time of which it tells.
    unknowns : tuple of Parameter
        What it leaves unknown besides the material.
    build : callable
        Takes relaxation times (term,) and returns the evidence.
    """

    material: str
    nu: float
    window: tuple[float, float]
    unknowns: tuple[Parameter, ...]
    build: Callable[[Array], Evidence]


@dataclass(frozen=True, slots=True)
class Kind:
    """What a kind of experiment needs and how it is gathered; a text says why it cannot be."""

    stages: tuple[str, ...]
    gather: Callable[[Inputs, Experiment, int], Proof | str]
    holder: str

    def choice(self, experiment: Experiment) -> Any:
        """Return the table that names the material."""
        return getattr(experiment.settings, self.holder)

    def material(self, experiment: Experiment) -> str:
        """Return how the session names the material; another temperature is another material."""
        choice = self.choice(experiment)
        name = choice.material or choice.material_from or choice.material_file
        at = "" if choice.temperature is None else f" at {choice.temperature.value:g} degC"
        return referred(str(name)) + at


def _solid(inputs: Inputs, experiment: Experiment, holder: str) -> Prony:
    """Return the material that the session assumes: only its Poisson's ratio is used."""
    choice = getattr(experiment.settings, holder)
    if choice.material_from is not None:
        fitted = inputs.result(referred(choice.material_from), "master_curve")
        return resolve(choice, None, fitted)
    file = None if choice.material_file is None else inputs.folder / choice.material_file
    return resolve(choice, file, None)


def _nuisance(name: str, mean: float, sd: float, unit: str, text: str) -> Parameter:
    return Parameter(name, mean, sd, unit, text, is_nuisance=True)


_FILTER = _nuisance(
    "filter", 0.0, 1.0, "1", "delay of the cell's filter, in units of its uncertainty"
)
"""One cell tests all specimens of a session: relaxation and oscillation share its filter."""


def _body(experiment: Experiment) -> tuple[dict[str, str], list[Parameter]]:
    """Return mass and radius of a sphere; equal spheres are one."""
    sphere = experiment.settings.sphere  # type: ignore[attr-defined]
    names, unknowns = {}, []
    for role, given, text in (
        ("mass", sphere.mass, "mass that moves"),
        ("radius", sphere.radius, "radius of the sphere"),
    ):
        if given.u > 0.0:
            names[role] = f"{role} {given.value:g} {given.si}"
            unknowns.append(_nuisance(names[role], given.value, given.u, given.si, text))
    return names, unknowns


def _drop_model(
    inputs: Inputs, experiment: Experiment, names: dict[str, str], unknowns: list[Parameter]
) -> DropModel:
    """Return the model of a drop, with the plate's mass among its unknowns."""
    settings: Any = experiment.settings
    found = None
    if settings.plate_from is not None:
        found = inputs.result(referred(settings.plate_from), "plate")
    plate = resolve_plate(settings.plate, found)
    mass = plate_inputs(settings.plate, found).get("mass")
    if plate is not None and mass is not None and mass.u > 0.0:
        names["plate"] = "mass of the plate"
        unknowns.append(
            _nuisance(names["plate"], plate.mass, mass.u, "kg", "modal mass of the plate")
        )
    empty = np.empty(0, dtype=np.int64)
    return DropModel(
        settings.sphere.radius.value, settings.sphere.mass.value, settings.height.value,
        settings.model.gravity.value, empty, empty, empty, 0.0, 0.0, names,
        settings.model.profile, plate, settings.model.rtol,
    )  # fmt: skip


def _height(experiment: Experiment, heights: Array) -> Parameter:
    """Return the mean height of the repeats: the stated one, as far as it is repeated."""
    given = experiment.settings.height  # type: ignore[attr-defined]
    spread = float(np.std(heights, ddof=1)) if heights.size > 1 else 0.0
    sd = float(np.hypot(given.u, spread / np.sqrt(max(heights.size, 1))))
    if sd == 0.0:
        message = (
            f"{experiment.name}: the height is stated without an uncertainty; write it as "
            f'"{given.value * 1e3:g} ± 0.01 mm"'
        )
        raise InputError(message)
    name = f"{experiment.name} height"
    return _nuisance(name, given.value, sd, "m", "mean height of the drops")


def _ball_drop(inputs: Inputs, experiment: Experiment, impacts: int) -> Proof | str:
    settings: Any = experiment.settings
    made = [inputs.result(experiment.name, "bounces", file) for file in settings.laser]
    count = min(impacts + 1, *(b.sizes["impact"] for b in made))
    if count < 2:
        return "fewer than two impacts were seen"
    touch = np.array([b["touch_time"].values[:count] - float(b["touch_time"][0]) for b in made])
    own = np.array([b["u_touch_time"].values[:count] for b in made])
    n = len(made)
    u_touch = np.maximum(np.sqrt(np.mean(own**2, axis=0)), _scatter(touch)) / np.sqrt(n)
    u_touch = np.maximum(u_touch, _LEAST_OF_TIME * touch.mean(axis=0))
    table = inputs.result(experiment.name, "repeats").isel(impact=slice(count))
    names, unknowns = _body(experiment)
    height = _height(experiment, np.array([float(b["drop_height"]) for b in made]))
    trigger = _nuisance(
        f"{experiment.name} trigger", 0.0, float(u_touch[0]), "s", "delay of the first contact"
    )
    names |= {"height": height.name, "trigger": trigger.name}
    unknowns += [height, trigger]
    none = np.full(count, np.nan)
    seen = Bounces(
        touch.mean(axis=0), u_touch, table["contact_duration"].values[:count],
        table["u_contact_duration"].values[:count], none, none,
    )  # fmt: skip
    return _proof_of_drop(inputs, experiment, seen, names, unknowns)


def _scatter(touch: Array) -> Array:
    """Return the scatter (impact,) of times between repeats that their heights do not explain.

    All times go with the root of the height: what repeats have in common with the mean is height.
    """
    if len(touch) < 3:
        return np.zeros(touch.shape[1])
    mean = touch.mean(axis=0)
    share = touch @ mean / (mean @ mean)
    rest = touch - share[:, None] * mean
    return np.asarray(np.sqrt(np.sum(rest**2, axis=0) / (len(touch) - 1)))


def _contact_area(inputs: Inputs, experiment: Experiment, impacts: int) -> Proof | str:
    made = inputs.result(experiment.name, "impacts")
    count = min(impacts, made.sizes["impact"])
    if not count:
        return "no impact was seen in the film"
    film = inputs.result(experiment.name, "radius")
    relative = float(film.attrs["u_systematic_relative"])
    radius = made["peak_radius"].values[:count]
    u = np.sqrt(np.maximum(made["u_peak_radius"].values[:count] ** 2 - (relative * radius) ** 2,
                           (_LEAST_RELATIVE * radius) ** 2))  # fmt: skip
    names, unknowns = _body(experiment)
    height = _height(experiment, np.empty(0))
    pixel = _nuisance(f"{experiment.name} scale", 1.0, relative, "1", "scale of the film")
    names |= {"height": height.name, "pixel": pixel.name}
    unknowns += [height, pixel]
    none = np.full(count, np.nan)
    seen = Bounces(none, none, none, none, radius, u)
    return _proof_of_drop(inputs, experiment, seen, names, unknowns)


def _proof_of_drop(
    inputs: Inputs, experiment: Experiment, seen: Bounces, names: dict[str, str],
    unknowns: list[Parameter],
) -> Proof:  # fmt: skip
    model = _drop_model(inputs, experiment, names, unknowns)
    evidence = drop_evidence(experiment.name, seen, model)
    solid = _solid(inputs, experiment, "sphere")
    return Proof(
        KINDS[experiment.kind].material(experiment), float(solid.nu), evidence.model.window,
        tuple(unknowns), lambda rho: evidence,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Punched:
    """What relaxation and harmonic indentation share."""

    geometry: Geometry
    nu: float
    unknowns: list[Parameter]
    factors: tuple[str, ...]


def _punched(inputs: Inputs, experiment: Experiment, loads: xr.Dataset, depth: float
             ) -> _Punched | str:  # fmt: skip
    settings: Any = experiment.settings
    if settings.punch is None or settings.substrate is None:
        return "session.toml names no punch and no substrate"
    nu = float(_solid(inputs, experiment, "substrate").nu)
    geometry = Geometry.of(settings.punch, settings.substrate, settings.model, nu)
    unknowns, factors = [], []
    relative = combined(relative_sources(depth, 0.0, geometry))
    gain = holds.relative_gain(loads)
    for name, sd, text in (
        ("punch", relative, "effect of the punch's dimensions on the force"),
        ("load cell", gain, "gain of the load cell"),
    ):
        if sd > 0.0:
            unknowns.append(_nuisance(name, 1.0, sd, "1", text))
            factors.append(name)
    return _Punched(geometry, nu, unknowns, tuple(factors))


def _relaxation(inputs: Inputs, experiment: Experiment, impacts: int) -> Proof | str:
    del impacts
    settings: Any = experiment.settings
    parts = []
    for number, file in enumerate(settings.mach1):
        loads, ramps, curves = (
            inputs.result(experiment.name, stage, file) for stage in ("loads", "ramps", "curves")
        )
        if not np.isfinite(float(ramps["contact_position"])):
            return f"first touch was not found in {file}"
        shared = _punched(inputs, experiment, loads, float(ramps["depth"].max()))
        if isinstance(shared, str):
            return shared
        label = experiment.name + (f" {number + 1}" if len(settings.mach1) > 1 else "")
        parts.append(_Hold(label, loads, ramps, curves, shared))
    unknowns = [p for part in parts for p in part.unknowns]
    lags = np.concatenate([part.lag for part in parts])
    return Proof(
        KINDS[experiment.kind].material(experiment), parts[0].shared.nu,
        (float(lags.min()), float(lags.max())), tuple(unknowns),
        lambda rho: _joined(experiment.name, [part.evidence(rho) for part in parts]),
    )  # fmt: skip


class _Hold:
    """Ramps and holds of one file as evidence.

    A number is the mean of a bin's readings behind the cell's filter, which comes late by the
    filter's delay. Half of two forces, a standard deviation of the readings' times before and
    after their mean, has the mean of any arc of second degree.
    """

    def __init__(self, label: str, loads: xr.Dataset, ramps: xr.Dataset, curves: xr.Dataset,
                 shared: _Punched) -> None:  # fmt: skip
        self.label, self.shared = label, shared
        declared = mach1_file.declared_filter(loads)
        quickest = 0.0 if declared is None else _DELAYS / (2.0 * np.pi * declared["cutoff"])
        lag, force = curves["mean_time"].values, curves["force"].values
        kept = (lag >= quickest) & np.isfinite(force)
        self.lag, self.force, width = lag[kept], force[kept], curves["time_spread"].values[kept]
        self.u = np.maximum(curves["u_force"].values[kept], _LEAST_OF_FORCE * self.force)
        self.zero = _nuisance(f"{label} first touch", 0.0, float(ramps["u_contact_position"]), "m",
                              "stage position of first touch")  # fmt: skip
        self.tare = _nuisance(
            f"{label} tare", 0.0, max(float(loads["u_tare"]), 1e-6), "N", "zero of the force"
        )
        delay = mach1_file.filter_delay(loads)
        self.u_delay = delay.u
        at = _clock_of(loads, np.nonzero(kept)[0]) + self.lag - delay.value
        self.places = np.array([at - width, at + width, at - width - delay.u, at + width - delay.u])
        self._follow(loads, float(ramps["contact_position"]))

    def _follow(self, loads: xr.Dataset, touch: float) -> None:
        """Keep the history of the contact: what no choice of relaxation times changes."""
        clock, position = mach1_file.clock(loads), loads["position_z"].values
        kept = mach1_file.history(clock, position)
        self.time = np.union1d(clock[kept], self.places)
        self.rows = np.searchsorted(self.time, self.places)
        self.areas = [
            np.interp(self.time, clock[kept],
                      elastic_area(position[kept] - touch - shift, self.shared.geometry))
            for shift in (0.0, _SHIFT)
        ]  # fmt: skip

    @property
    def unknowns(self) -> list[Parameter]:
        late = [_FILTER] if self.u_delay > 0.0 else []
        return [*self.shared.unknowns, self.zero, self.tare, *late]

    def _basis(self, rho: Array, area: Array) -> tuple[Array, Array]:
        """Return the basis (number, 1 + term), and the same with a delay one deviation longer."""
        made = lee_radok_basis(self.time, area, rho, self.shared.nu)
        early, late, *longer = (made[rows] for rows in self.rows)
        return 0.5 * (early + late), 0.5 * (longer[0] + longer[1])

    def evidence(self, rho: Array) -> Evidence:
        basis, longer = self._basis(rho, self.areas[0])
        shifts = {self.zero.name: (self._basis(rho, self.areas[1])[0] - basis) / _SHIFT}
        if self.u_delay > 0.0:
            shifts[_FILTER.name] = longer - basis
        return force_evidence(
            self.label, self.lag, self.force, self.u, basis, shifts=shifts,
            factors=self.shared.factors, offsets=(self.tare.name,),
        )  # fmt: skip


def _clock_of(loads: xr.Dataset, ramp: NDArray[np.intp]) -> Array:
    """Return the file's time (number,) at which the stage arrived from every number's ramp."""
    clock, time = mach1_file.clock(loads), loads["time"].values
    begins = [clock[h.rows.start] - time[h.rows.start] + h.end for h in holds.find(loads)]
    return np.asarray(np.array(begins)[ramp])


def _joined(name: str, parts: list[Evidence]) -> Evidence:
    """Return the holds of several files as one experiment."""
    from labpipe.identification.joined import JoinedModel

    if len(parts) == 1:
        return parts[0]
    groups = tuple(
        replace(g, name=f"{g.name}, test {i + 1}")
        for i, part in enumerate(parts)
        for g in part.groups
    )
    return Evidence(name, groups, JoinedModel(tuple(part.model for part in parts)))


def _harmonic(inputs: Inputs, experiment: Experiment, impacts: int) -> Proof | str:
    del impacts
    settings: Any = experiment.settings
    loads, waves = (inputs.result(experiment.name, stage) for stage in ("loads", "oscillations"))
    touch, _ = mach1_file.contact_position(loads, settings.contact)
    mean = waves["mean_position"].values - touch.value
    shared = _punched(inputs, experiment, loads, float(mean.max()))
    if isinstance(shared, str):
        return shared
    if mean.min() <= 0.0:
        return "an oscillation lies above first touch"
    frequency = waves["frequency"].values
    zero = _nuisance(f"{experiment.name} first touch", 0.0, touch.u, "m",
                     "stage position of first touch")  # fmt: skip
    omega = 2.0 * np.pi * frequency

    def slope(shift: float) -> Array:
        ends = [elastic_force(mean - shift + s * _SHIFT, shared.geometry) for s in (1, -1)]
        return np.asarray((ends[0] - ends[1]) / (2.0 * _SHIFT))

    storage, loss, by_phase = _stiffness(loads, waves)
    late = [_FILTER] if by_phase.any() else []
    here = slope(0.0)
    by_zero = (slope(_SHIFT) - slope(-_SHIFT)) / (2.0 * _SHIFT)

    def build(rho: Array) -> Evidence:
        return stiffness_evidence(
            experiment.name, frequency, storage, loss, here, rho, shared.nu,
            slope_by={zero.name: by_zero},
            factors=shared.factors, offsets={p.name: by_phase for p in late},
            fuller=_Oscillation(loads, waves, touch.value, shared.geometry, zero.name),
        )  # fmt: skip

    return Proof(
        KINDS[experiment.kind].material(experiment), shared.nu,
        (1.0 / float(omega.max()), 1.0 / float(omega.min())),
        (*shared.unknowns, zero, *late), build,
    )  # fmt: skip


def _stiffness(
    loads: xr.Dataset, waves: xr.Dataset
) -> tuple[tuple[Array, Array], tuple[Array, Array], Array]:
    """Return storage and loss with their random part, and what one deviation of delay does.

    The filter's delay turns all phases the same way and the cell's gain stretches all forces: each
    is one unknown, not noise.
    """
    storage, loss = waves["storage_stiffness"].values, waves["loss_stiffness"].values
    lags = [mach1_file.force_lag(loads, f) for f in waves["frequency"].values.tolist()]
    is_late = bool(waves.attrs["is_filter_corrected"])
    u_phase = np.array([lag.u_phase if lag and is_late else 0.0 for lag in lags])
    by_phase = np.concatenate([loss * u_phase, -storage * u_phase])
    u = np.concatenate([waves[f"u_{n}_stiffness"].values for n in ("storage", "loss")])
    of_gain = holds.relative_gain(loads) * np.concatenate([storage, loss])
    least = _LEAST_OF_STIFFNESS * np.tile(np.hypot(storage, loss), 2)
    own = np.sqrt(np.maximum(u**2 - by_phase**2 - of_gain**2, least**2))
    return (storage, own[: storage.size]), (loss, own[storage.size :]), by_phase


@dataclass(frozen=True, eq=False)
class _Oscillation:
    """Stiffness of the whole simulated file: finite amplitude, edges that come and go.

    The simulation moves along chords between the readings. What these do to a sinusoid is known
    in closed form for every term (:func:`along_chords`), and is taken out.
    """

    loads: xr.Dataset
    waves: xr.Dataset
    touch: float
    geometry: Geometry
    zero: str

    def __call__(self, material: Prony, given: Any) -> Array:
        geometry, time = self.geometry, mach1_file.clock(self.loads)
        depth = self.loads["position_z"].values - self.touch - given[self.zero]
        kept = mach1_file.history(time, depth)
        made = contact.indent(
            material, geometry.radius.value, geometry.period.value,
            geometry.depth.value * geometry.tips, time[kept], depth[kept],
            profile=geometry.model.profile, thickness=geometry.thickness,
            elements=geometry.model.elements,
        )  # fmt: skip
        force = np.interp(time, time[kept], made["force"].values)
        found = []
        for i in range(self.waves.sizes["oscillation"]):
            at = self.waves.isel(oscillation=i)
            rows = mach1_file.rows(self.loads, int(at["block"]))
            clock = self.loads["time"].values[rows]
            used = (clock >= float(at["begin"])) & (clock <= float(at["end"]))
            position = self.loads["position_z"].values[rows][used]
            wave = common_fit(clock[used], position, force[rows][used], float(at["frequency"]))
            exact = along_chords(
                material, wave.position.frequency, float(np.median(np.diff(clock)))
            )
            found.append(complex(wave.storage_stiffness, wave.loss_stiffness) / exact)
        stiffness = np.array(found)
        return np.concatenate([stiffness.real, stiffness.imag])


def along_chords(material: Prony, frequency: float, interval: float) -> complex:
    """Return by what the modulus of a sampled sinusoid with chords between differs.

    Parameters
    ----------
    material : Prony
    frequency, interval : float [Hz], [s]
        Of the sinusoid, and between its samples.

    Returns
    -------
    complex
        Ratio of force over strain at the samples to the complex modulus; second order in the
        interval.

    Notes
    -----
    Over a chord a Maxwell term relaxes by d = exp(-x), x = interval / rho, and gains (1 - d) / x
    of the step of strain: with z = exp(i omega interval) its modulus is that of this recursion,
    E (1 - d) / x (1 - 1/z) / (1 - d/z).

    Examples
    --------
    >>> rubber = Prony(1e6, [1e6], [0.1])
    >>> [round(abs(along_chords(rubber, 2.5, 0.01 / n) - 1) * 1e4, 2) for n in (1, 2)]
    [6.24, 1.56]
    """
    turn, x = np.exp(-2j * np.pi * frequency * interval), interval / np.asarray(material.rho)
    gained = -np.expm1(-x) / x * (1.0 - turn) / (1.0 - np.exp(-x) * turn)
    exact = material.complex_modulus(2.0 * np.pi * frequency)
    return complex((material.E_relaxed + np.asarray(material.E) @ gained) / exact)


KINDS: dict[str, Kind] = {
    "ball_drop": Kind(("bounces", "repeats"), _ball_drop, "sphere"),
    "contact_area": Kind(("radius", "impacts"), _contact_area, "sphere"),
    "relaxation": Kind(("loads", "ramps", "curves"), _relaxation, "substrate"),
    "harmonic": Kind(("loads", "oscillations"), _harmonic, "substrate"),
}
"""Kinds that tell of a material."""


def dma_prior(
    inputs: Inputs, name: str, experiments: list[Experiment], rho: Array
) -> tuple[Evidence, Parameter]:
    """Return the moduli of a rheometer experiment, at the temperature of the others, as prior.

    Parameters
    ----------
    inputs : Inputs
    name : str
        Of the rheometer experiment, from :func:`rheometer`.
    experiments : list of Experiment
        On one material at one temperature.
    rho : array (term,) [s]
        Relaxation times of the spectrum.
    """
    solid, (low, high) = _master_curve(inputs, name, experiments)
    places = np.geomspace(low, high, max(int(np.log10(high / low) * _PER_DECADE), 2))
    modulus = solid.complex_modulus(2.0 * np.pi * places)
    u = [noise * part for noise, part in zip(_LEAST_NOISE, (modulus.real, modulus.imag),
                                             strict=True)]  # fmt: skip
    scale = _nuisance(f"{name} specimen", 1.0, _SPECIMEN, "1", "size of the rheometer's specimen")
    evidence = modulus_evidence(
        name, places, (modulus.real, u[0]), (modulus.imag, u[1]), rho, factors=(scale.name,)
    )
    return evidence, scale


def dma_window(
    inputs: Inputs, name: str, experiments: list[Experiment]
) -> tuple[float, float]:  # fmt: skip
    """Return the shortest and the longest time of which a rheometer's moduli tell [s].

    The spectrum must reach as far: one that ends before could not explain them.
    """
    _, (low, high) = _master_curve(inputs, name, experiments)
    return 0.5 / np.pi / high, 0.5 / np.pi / low


def _master_curve(
    inputs: Inputs, name: str, experiments: list[Experiment]
) -> tuple[Prony, tuple[float, float]]:
    """Return the rheometer's material at the others' temperature, and its frequencies [Hz]."""
    fitted = inputs.result(name, "master_curve")
    choice = KINDS[experiments[0].kind].choice(experiments[0])
    solid = resolve(choice if choice.material_from else _plain(choice, name), None, fitted)
    frequency = inputs.result(name, "sweeps")["frequency"].values
    shift = 10.0 ** fitted["log10_aT"].values
    own = float(solid.rho[0] / fitted["rho"].values[0]) if len(solid.rho) else 1.0
    return solid, (
        float(frequency.min() * shift.min() / own), float(frequency.max() * shift.max() / own)
    )  # fmt: skip


def references(experiment: Experiment) -> list[str]:
    """Return what an experiment takes from others: the plate under it, the assumed material."""
    plate = getattr(experiment.settings, "plate_from", None)
    found = [] if plate is None else [f"{referred(plate)}/plate"]
    material = KINDS[experiment.kind].choice(experiment).material_from
    return found if material is None else [*found, f"{referred(material)}/master_curve"]


def _plain(choice: Any, name: str) -> Any:
    import msgspec

    return msgspec.structs.replace(choice, material=None, material_file=None, material_from=name)


def rheometer(session: Session, wanted: str, experiments: list[Experiment]) -> str:
    """Return the name of the rheometer experiment that is the prior of a material.

    ``dma`` stands for the one that the material is taken from, else for the only one, else for
    the only one whose name begins with that of the material.

    Raises
    ------
    UsageError
        There is no such experiment, or it is not clear which one is meant.
    """
    sweeps = [n for n, e in session.experiments.items() if e.kind == "dma"]
    if wanted in sweeps:
        return wanted
    if wanted != "dma":
        known = ", ".join(sweeps) or "none"
        message = f'there is no rheometer experiment "{wanted}"; known are: {known}'
        raise UsageError(message)
    choices = [KINDS[e.kind].choice(e) for e in experiments]
    named = {referred(c.material_from) for c in choices if c.material_from}
    alike = [n for n in sweeps for c in choices[:1] if c.material and n.startswith(c.material)]
    for possible in (sorted(named), sweeps, alike):
        if len(possible) == 1:
            return possible[0]
    found = ", ".join(sweeps) or "none"
    message = (
        f"{experiments[0].name}: which rheometer experiment is the prior? Give --prior NAME; "
        f"there are: {found}"
    )
    raise UsageError(message)
