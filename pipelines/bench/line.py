"""Indentation by a periodic punch: elastic line against tamaas, tapping against the thesis's scheme.

Truth: Westergaard's pressure; the forces of a tapping cylinder by the closed form of the half-plane's springs at
8000 steps a cycle. Peer: tamaas (boundary elements with FFT), https://doi.org/10.21105/joss.02121.
"""

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.contact.line import westergaard
from labpipe.materials import Prony
from pipelines.bench.measure import OURS, THESIS, Extra, Suite, race
from pipelines.rig.apparatus import PUNCH

_MEAN = 0.2  # pressure over that of full contact
_PUNCH = PUNCH.radius, PUNCH.period
#: Half width of the elastic line over the period: its sin² is the mean pressure over that of full contact.
_SHARE = float(np.arcsin(np.sqrt(_MEAN)) / np.pi)


class _Solid(NamedTuple):
    """A material under ``2e-4 (0.2 - 0.8 cos 2πt)`` m: forces (N/m) at some times, and peak."""

    name: str
    terms: int
    unrelaxed: float
    tau: tuple[float, float]
    forces: tuple[float, ...]
    peak: float
    times: tuple[float, ...] = (0.25, 0.40, 0.50, 0.60, 0.70, 1.50)


_SOLIDS = (
    _Solid(
        "one term of 0.05 s",
        1,
        4e9,
        (-1.3010299956639813, 0.0),
        (76097.57, 347012.22, 393383.73, 280053.48, 93998.13, 393383.73),
        397765.82,
    ),
    _Solid(
        "15 terms from 1e-10 to 1e2 s",
        15,
        6e9,
        (-10.0, 2.0),
        (62947.81, 371090.50, 454242.82, 352210.99, 141573.81, 450569.04),
        454529.8,
    ),
)


def run(quick: bool) -> list[Suite]:
    """Measure the elastic line, and tapping of two materials."""
    return [_elastic(quick), *(_tapping(quick, solid) for solid in _SOLIDS)]


def _elastic(quick: bool, most_factored: int = 4096) -> Suite:
    has_peer = find_spec("tamaas") is not None
    calls: dict[str, tuple[str, Callable[[], object]]] = {}
    for n in (64, 256, 1024) if quick else (64, 256, 1024, 4096, 16384):
        # All strips that may be touched are factored: not for the finest grids.
        if n <= most_factored:
            calls[f"springs, {n} strips"] = OURS, partial(_pressure, n)
        if has_peer:
            calls[f"tamaas, {n} points"] = "tamaas", partial(tamaas_pressure, n)

    def judge(_: str, found: Any) -> tuple[float, Extra]:
        return pressure_error(found), {}

    title = "Elastic half-plane under a cosine, mean pressure 0.2 p*: against Westergaard"
    points = race(calls, 3 if quick else 7, judge, "springs, 1024 strips", budget=60.0)
    notes = [] if has_peer else ["tamaas is not installed: no peer for the elastic line."]
    return Suite("line-elastic", title, "relative L2 error of the pressure (1)", points, notes=notes)


def _pressure(elements: int) -> Floats:
    """Return the pressure (element,) over its mean, centred."""
    solid = Prony(1.0, [], [], nu=0.0)
    approach = [float(westergaard.from_half_width(_SHARE * PUNCH.period, *_PUNCH, 1.0, "cosine").displacement)]
    options: dict[str, Any] = {"elements": elements, "outputs": ("pressure",)}
    found = contact.indent(solid, *_PUNCH, 1.0, [0.0], approach, "cosine", **options)
    pressure: Floats = found.pressure.values[0]
    return pressure / pressure.mean()


def tamaas_pressure(points: int) -> Floats:
    """Return the pressure (point,) over its mean by tamaas; a new model for every call starts from no solution."""
    import tamaas

    tamaas.set_log_level(tamaas.LogLevel.error)
    model = tamaas.ModelFactory.createModel(tamaas.model_type.basic_1d, [1.0], [points])
    model.E, model.nu = 1.0, 0.0
    surface = np.cos(2.0 * np.pi * np.arange(points) / points) - 1.0
    by_pressure = tamaas.PolonskyKeerRey.pressure
    tamaas.PolonskyKeerRey(model, surface, 1e-12, by_pressure, by_pressure).solve(_MEAN * np.pi)
    return np.roll(np.array(model.traction).ravel(), points // 2) / (_MEAN * np.pi)


def pressure_error(found: object) -> float:
    """Return the relative L2 error of a pressure over its mean (strip,), centred, against Westergaard's."""
    pressure = np.asarray(found, float)
    n = pressure.size
    x = (np.arange(n) - n // 2) / n
    exact = westergaard.pressure(x, _SHARE, 1.0, 1.0, 1.0, "cosine") * 4.0 * np.pi / _MEAN
    return float(np.linalg.norm(pressure - exact) / np.linalg.norm(exact))


def _tapping(quick: bool, solid: _Solid) -> Suite:
    share = np.full(solid.terms, (1 / 2e9 - 1 / solid.unrelaxed) / solid.terms)
    material = Prony.from_creep(2e9, share, np.logspace(*solid.tau, solid.terms), nu=0.35)

    def ours(rtol: float) -> Callable[[], object]:
        history = _history(400)
        return lambda: contact.indent(material, *_PUNCH, 1.0, *history, elements=1024, rtol=rtol)

    def thesis(per_cycle: int) -> Callable[[], object]:
        history = _history(per_cycle)
        return lambda: contact.indent(material, *_PUNCH, 1.0, *history, elements=256, solver="thesis")

    def judge(_: str, found: Any) -> tuple[float, Extra]:
        shown = np.interp(solid.times, found.time.values, found.force.values)
        return float(np.abs(shown - np.array(solid.forces)).max() / solid.peak), {}

    calls = {f"adaptive, rtol {r:.0e}": (OURS, ours(r)) for r in ((1e-5,) if quick else (1e-3, 1e-4, 1e-5))}
    steps = (20, 100) if quick else (20, 40, 100, 200, 400, 1000)
    calls |= {f"thesis's scheme, {n} steps a cycle": (THESIS, thesis(n)) for n in steps}
    points = race(calls, 1 if quick else 3, judge, "adaptive, rtol 1e-05", budget=60.0)
    name, title = f"line-tapping-{solid.terms}", f"Two cycles of tapping by a cylinder, {solid.name}"
    return Suite(name, title, "worst error of the force over its peak (1)", points)


def _history(per_cycle: int) -> tuple[Floats, Floats]:
    time = np.arange(2 * per_cycle + 1) / per_cycle
    return time, 2e-4 * (0.2 - 0.8 * np.cos(2.0 * np.pi * time))
