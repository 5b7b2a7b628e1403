"""Sweeps of the simulator: the product of axes, times random draws of uncertain inputs, computed block by block."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from labpipe import files
from labpipe.errors import InputError, UsageError
from labpipe.units import Quantity, quantity
from labpipe.variables import variable
from labpipe.workflow import code
from labpipe.workflow.engines import Died, choose, processors, side_by_side
from labpipe.workflow.fields import suggest
from labpipe.workflow.store import key_of
from pipelines.simulator_inputs import material
from pipelines.sweeps.simulators import DRAW, SIMULATORS, Design, Outputs, Parameter, Value

if TYPE_CHECKING:
    import xarray as xr

Stated = Mapping[str, str | float]
Outcome = Outputs | str
"""Numbers of a point, or the reason why there are none."""

BLOCK = 25
"""Points handed to a worker at a time: about a second of work, small against a restart."""
MOST_BLOCKS = 4000
"""Larger sweeps have larger blocks: each is a file, flushed to the disk while workers wait."""
_IMPORTS = ("numpy", "xarray", "labpipe.contact", "pipelines.sweeps.simulators")


@dataclass(frozen=True, slots=True)
class Swept:
    """A finished sweep: its netCDF file and its content.

    ``dataset`` holds every output over the named dimensions, ``problem`` where a point failed. ``computed``,
    ``reused`` and ``failed`` count points computed now, taken from an earlier run, and without result.
    """

    path: Path
    dataset: xr.Dataset
    computed: int
    reused: int
    failed: int

    @property
    def page(self) -> Path:
        """The page that the verb writes to the same folder."""
        return self.path.with_suffix(".html")

    @property
    def summary(self) -> str:
        """Say in one line how many points were computed."""
        return f"{self.computed} points computed, {self.reused} reused, {self.failed} without result"


def sweep(
    simulator: str,
    out: str | Path,
    *,
    vary: Mapping[str, str] | None = None,
    fixed: Stated | None = None,
    draws: int = 0,
    seed: int = 0,
    jobs: int = 1,
    cluster: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> Swept:
    """Simulate every combination of some parameters; write one netCDF file and a page.

    Blocks that are done are kept in ``OUT.parts`` until the sweep is complete: the same call resumes a stopped sweep
    and retries failed points. The same points give the same bytes, wherever and however often they are computed.

    Parameters
    ----------
    simulator : {"drop", "indent"}
    out : path-like
        netCDF file; the page is written to the same folder.
    vary : mapping
        Values of swept parameters: ``{"height": "1 mm : 10 mm : 7"}``, with ``: log`` for equal
        ratios, or a list ``{"material": "acrylic, ptfe"}``.
    fixed : mapping
        Other parameters, ``{"radius": "9.525 ± 0.005 mm"}``, or numbers in SI.
    draws, seed : int
        Random draws, the same at each point, of parameters with an uncertainty; and their seed.
    jobs : int
        Local processes; 0 for one per processor.
    cluster : str, optional
        Address of a Dask scheduler, which computes instead.
    progress : callable, optional
        Called with the fraction of the points that is done.

    Returns
    -------
    Swept
        With the map as a Dataset.

    Raises
    ------
    UsageError
        A parameter is unknown, given twice or in another unit, draws and uncertainties do not belong together, or
        ``out`` is no netCDF name.
    StorageError
        The file cannot be written.

    Examples
    --------
    >>> sweep("drop", "heights.nc", vary={"height": "1 mm, 5 mm, 10 mm"})  # doctest: +SKIP
    """
    path, plan = Path(out), design(simulator, vary or {}, fixed, draws=draws, seed=seed)
    if path.suffix != ".nc":
        raise UsageError(f"{path}: the result of a sweep is a netCDF file; give a name that ends in .nc")
    parts = path.with_name(f"{path.stem}.parts")
    function, size = SIMULATORS[plan.simulator].run, max(BLOCK, ceil(plan.count / MOST_BLOCKS))
    identity = key_of(code.behind(f"{function.__module__}:{function.__name__}"))
    # the name of a material alone does not say what was simulated
    solids = {str(name): material(str(name)) for name in plan.axes.get("material") or [plan.fixed["material"]]}
    contents = {name: [one.E_relaxed, one.E.tolist(), one.rho.tolist(), one.nu] for name, one in solids.items()}
    blocks: dict[str, range] = {}
    found: dict[str, Sequence[Outcome]] = {}
    for start in range(0, plan.count, size):
        block = range(plan.count)[start : start + size]
        key = hashlib.sha256(files.canonical([identity, contents, plan.points(block)]).encode()).hexdigest()
        blocks[key] = block
        kept = files.unseal(part.read_bytes()) if (part := parts / f"{key}.json").is_file() else None
        # failed points are tried again
        if isinstance(kept, list) and len(kept) == len(block) and not any(isinstance(one, str) for one in kept):
            found[key] = kept
    reused = sum(map(len, found.values()))
    missing = {key: (plan, block) for key, block in blocks.items() if key not in found}
    engine = choose((jobs or processors()) if jobs != 1 else 0, cluster)
    for key, answer in side_by_side(engine, compute, missing, imports=_IMPORTS):
        found[key] = [str(answer)] * len(blocks[key]) if isinstance(answer, Died) else answer
        files.write_bytes(parts / f"{key}.json", files.seal(found[key]))
        if progress is not None:
            progress(sum(map(len, found.values())) / plan.count)
    outcomes = [one for key in blocks for one in found[key]]
    dataset, failed = _dataset(plan, outcomes, identity), sum(isinstance(one, str) for one in outcomes)
    files.write_dataset(path, dataset)
    if not failed and parts.is_dir():
        shutil.rmtree(parts)
    swept = Swept(path, dataset, plan.count - reused, reused, failed)
    from pipelines.sweeps.page import render  # the page's kit is of no use to a worker

    files.write_text(swept.page, render(plan, dataset, path.name))
    return swept


def compute(plan: Design, numbers: range) -> list[Outcome]:
    """Simulate some points of a design; a point that fails is its message."""
    try:
        return [*SIMULATORS[plan.simulator].run(plan.points(numbers))]
    except Exception as error:
        if len(numbers) == 1:
            return [f"{type(error).__name__}: {error}"]
    # A point of a map may lie where there is no answer: all are asked again, one by one, and the others go on.
    return [one for i in numbers for one in compute(plan, range(i, i + 1))]


def design(
    simulator: str, vary: Mapping[str, str], fixed: Stated | None = None, *, draws: int = 0, seed: int = 0
) -> Design:
    """Spell out a sweep; arguments as of :func:`sweep`, and its UsageError.

    Examples
    --------
    >>> design("drop", {"height": "1 mm : 4 mm : 3 : log"}).axes
    {'height': (0.001, 0.002, 0.004)}
    """
    given = dict(fixed or {})
    axes = {name: _axis(simulator, name, text) for name, text in vary.items()}
    if twice := axes.keys() & given.keys():
        raise UsageError(f"{min(twice)} is given twice")
    known = {name: parameter.default for name, parameter in SIMULATORS[simulator].parameters.items()}
    stated = {n: None if v is None else _value(simulator, n, v) for n, v in (known | given).items() if n not in axes}
    spread = {name: v for name, v in stated.items() if isinstance(v, Quantity) and v.u > 0.0}
    if spread and not draws:
        raise UsageError(f"{', '.join(spread)} has an uncertainty: give the number of draws")
    if draws and not spread:
        raise UsageError('nothing to draw: give a fixed parameter an uncertainty, "9.525 ± 0.005 mm"')
    generator = np.random.default_rng(seed)
    drawn = {name: tuple(generator.normal(q.value, q.u, draws).tolist()) for name, q in spread.items()}
    return Design(simulator, axes, {n: v.value if isinstance(v, Quantity) else v for n, v in stated.items()}, drawn)


def _axis(simulator: str, name: str, text: str) -> tuple[Value, ...]:
    parts = [part.strip() for part in text.split(":")]
    if len(parts) == 1 or not _parameter(simulator, name).unit:
        given = [_value(simulator, name, part.strip()) for part in text.split(",")]
        if any(isinstance(v, Quantity) and v.u > 0.0 for v in given):
            raise UsageError(f"{name}: a swept value has no uncertainty; set it fixed, with draws")
        values: tuple[Value, ...] = tuple(v.value if isinstance(v, Quantity) else v for v in given)
        if len(set(values)) < len(values):
            raise UsageError(f"{name}: a value is given twice in {text}")
        return values
    is_log = parts[3:] == ["log"]
    if len(parts) != 3 + is_log or not parts[2].isdigit() or int(parts[2]) < 2:
        raise UsageError(
            f'{name}: cannot understand "{text}"; expected values separated by commas, or '
            '"first : last : number" of at least two points, with ": log" for equal ratios'
        )
    first, last = (v.value for part in parts[:2] if isinstance(v := _value(simulator, name, part), Quantity))
    if is_log and min(first, last) <= 0.0:
        raise UsageError(f"{name}: equal ratios need positive ends")
    spaced = (np.geomspace if is_log else np.linspace)(first, last, int(parts[2]))
    # Twelve digits: 0.004 and not 0.0040000000000000001 of one machine and ..2 of another.
    return tuple(float(f"{v:.12g}") for v in spaced)


def _parameter(simulator: str, name: str) -> Parameter:
    if simulator not in SIMULATORS:
        raise UsageError(f'no simulator "{simulator}"{suggest(simulator, SIMULATORS)}')
    known = SIMULATORS[simulator].parameters
    if name not in known:
        raise UsageError(f'no parameter "{name}"{suggest(name, known)}; there are {", ".join(known)}')
    return known[name]


def _value(simulator: str, name: str, given: str | float) -> Quantity | str:
    unit = _parameter(simulator, name).unit
    if not unit:
        return str(given)
    try:
        found = quantity(given) if isinstance(given, str) else Quantity(float(given), 0.0, unit)
    except InputError as error:
        raise UsageError(f"{name}: {error}") from error
    if found.si != unit:
        is_in = "has no unit" if found.si == "1" else f"is in {found.si}"
        raise UsageError(f'{name}: "{given}" {is_in}; expected {unit}')
    return found


def _dataset(plan: Design, outcomes: Sequence[Outcome], identity: str) -> xr.Dataset:
    import xarray as xr

    simulator, dims, shape = SIMULATORS[plan.simulator], tuple(plan.sizes), tuple(plan.sizes.values())
    variables: dict[str, Any] = {}
    for name, (unit, text) in simulator.outputs.items():
        values = np.array([np.nan if isinstance(one, str) else one[name] for one in outcomes])
        variables[name] = variable(dims, values.reshape(shape), unit, text)
    problems = np.array([one if isinstance(one, str) else "" for one in outcomes], dtype=object)
    variables["problem"] = variable(dims, problems.reshape(shape), "1", "Why a point has no result; empty when it has")
    coordinates: dict[str, Any] = {}
    for name, places in (plan.axes | plan.drawn).items():
        dim, text = (DRAW, f"Drawn {name}") if name in plan.drawn else (name, name.replace("_", " ").capitalize())
        coordinates[name] = variable(dim, np.array(places), simulator.parameters[name].unit or "1", text)
    attributes = {"simulator": plan.simulator, "simulator_code": identity, "origin": "simulated"}
    return xr.Dataset(variables, coordinates, attributes | {"fixed": files.canonical(plan.fixed)})
