"""Sweep the simulator block by block, so that a stopped sweep can resume; write its netCDF file and its page."""

from __future__ import annotations

import contextlib
import hashlib
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from labpipe import files
from labpipe.errors import UsageError
from labpipe.notebook import html_table
from labpipe.variables import variable
from labpipe.workflow import code
from labpipe.workflow.engines import Died, Engine, choose, processors, side_by_side
from labpipe.workflow.store import key_of
from pipelines.simulator_inputs import material
from pipelines.sweeps.grid import DRAW, Design, design
from pipelines.sweeps.simulators import SIMULATORS, Outputs

if TYPE_CHECKING:
    import xarray as xr

Outcome = Outputs | str
"""Numbers of a point, or the reason why there are none."""

BLOCK = 25
"""Points handed to a worker at a time: about a second of work, small against a restart."""
MOST_BLOCKS = 4000
"""Larger sweeps have larger blocks: each is a file, flushed to the disk while workers wait."""
COMPUTE = f"{__name__}:compute"
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

    def __repr__(self) -> str:
        return f"{self.summary}; {self.path}\n{self.dataset}"

    def _repr_html_(self) -> str:
        shown: str = self.dataset._repr_html_()
        return html_table(f"{self.summary}; {self.path}", (), ()) + shown


def sweep(
    simulator: str,
    out: str | Path,
    *,
    vary: Mapping[str, str] | None = None,
    fixed: Mapping[str, str | float] | None = None,
    draws: int = 0,
    seed: int = 0,
    jobs: int = 1,
    cluster: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> Swept:
    """Simulate every combination of some parameters; write one netCDF file and a page.

    The same call resumes a stopped sweep and retries failed points.

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
    draws : int
        Random draws, per point, of parameters with an uncertainty.
    seed : int
        Of the draws.
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
        A parameter is unknown or in another unit, or ``out`` is no netCDF name.
    StorageError
        The file cannot be written.

    Examples
    --------
    >>> sweep("drop", "heights.nc", vary={"height": "1 mm, 5 mm, 10 mm"})  # doctest: +SKIP
    """
    plan = design(simulator, vary or {}, fixed, draws=draws, seed=seed)
    engine = choose((jobs or processors()) if jobs != 1 else 0, cluster)
    swept = run_design(plan, out, engine, progress=progress)
    from pipelines.sweeps.page import render  # the page's kit is of no use to a worker

    files.write_text(swept.page, render(plan, swept.dataset, swept.path.name))
    return swept


def run_design(
    plan: Design, out: str | Path, engine: Engine | None = None, *, progress: Callable[[float], None] | None = None
) -> Swept:
    """Simulate every point of a design.

    Blocks that are done lie in ``OUT.parts`` until the sweep is complete; run again, only missing,
    damaged or failed ones are computed. The file does not depend on the engine, on the number
    of workers or on interruptions: the same points give the same bytes.

    Without an engine (:mod:`labpipe.workflow.engines`) all is done here; the other arguments, and the errors, are
    those of :func:`sweep`.
    """
    path = Path(out)
    if path.suffix != ".nc":
        raise UsageError(f"{path}: the result of a sweep is a netCDF file; give a name that ends in .nc")
    parts = path.with_name(f"{path.stem}.parts")
    size, identity = max(BLOCK, ceil(plan.count / MOST_BLOCKS)), code_of(plan.simulator)
    # the name of a material alone does not say what was simulated
    solids = {str(name): material(str(name)) for name in plan.axes.get("material") or [plan.fixed["material"]]}
    contents = {name: [one.E_relaxed, one.E.tolist(), one.rho.tolist(), one.nu] for name, one in solids.items()}
    blocks: dict[str, int] = {}
    for start in range(0, plan.count, size):
        text = files.canonical([identity, contents, plan.points(start, start + size)])
        blocks[hashlib.sha256(text.encode()).hexdigest()] = start
    found: dict[str, Sequence[Outcome]] = {}
    for key, start in blocks.items():
        kept = files.unseal(part.read_bytes()) if (part := parts / f"{key}.json").is_file() else None
        length = min(size, plan.count - start)
        # failed points are tried again
        if isinstance(kept, list) and len(kept) == length and not any(isinstance(one, str) for one in kept):
            found[key] = kept
    reused = sum(map(len, found.values()))
    missing = {key: (plan, start, start + size) for key, start in blocks.items() if key not in found}
    for key, answer in side_by_side(engine or choose(0), COMPUTE, missing, imports=_IMPORTS):
        length = min(size, plan.count - blocks[key])
        found[key] = [str(answer)] * length if isinstance(answer, Died) else answer
        files.write_bytes(parts / f"{key}.json", files.seal(found[key]))
        if progress is not None:
            progress(sum(map(len, found.values())) / plan.count)
    outcomes = [one for key in blocks for one in found[key]]
    dataset, failed = _dataset(plan, outcomes), sum(isinstance(one, str) for one in outcomes)
    files.write_dataset(path, dataset)
    if not failed and parts.is_dir():
        shutil.rmtree(parts)
    return Swept(path, dataset, plan.count - reused, reused, failed)


def compute(plan: Design, start: int, stop: int) -> list[Outcome]:
    """Simulate some points of a design; a point that fails is its message."""
    run, block = SIMULATORS[plan.simulator].run, plan.points(start, stop)
    # Where one point has no answer all are asked again, one by one, to find it.
    with contextlib.suppress(Exception):
        return [*run(block)]
    found: list[Outcome] = []
    for point in block:
        try:
            found += run([point])
        # A point of a map may lie where there is no answer: it is named and the others go on.
        except Exception as error:
            found.append(f"{type(error).__name__}: {error}")
    return found


def code_of(simulator: str) -> str:
    """Return a digest of the code that a simulator belongs to."""
    function = SIMULATORS[simulator].run
    return key_of(code.behind(f"{function.__module__}:{function.__name__}"))


def _dataset(plan: Design, outcomes: Sequence[Outcome]) -> xr.Dataset:
    import xarray as xr

    simulator, dims, shape = SIMULATORS[plan.simulator], tuple(plan.sizes), tuple(plan.sizes.values())
    variables: dict[str, Any] = {}
    for name, (unit, text) in simulator.outputs.items():
        values = np.array([np.nan if isinstance(one, str) else one[name] for one in outcomes])
        variables[name] = variable(dims, values.reshape(shape), unit, text)
    problems = np.array([one if isinstance(one, str) else "" for one in outcomes], dtype=object)
    variables["problem"] = variable(dims, problems.reshape(shape), "1", "Why a point has no result; empty when it has")
    coordinates: dict[str, Any] = {
        name: variable(
            name, np.array(values), simulator.parameters[name].unit or "1", name.replace("_", " ").capitalize()
        )
        for name, values in plan.axes.items()
    }
    for name, draws in plan.drawn.items():
        coordinates[name] = variable(DRAW, np.array(draws), simulator.parameters[name].unit, f"Drawn {name}")
    attributes = {
        "simulator": plan.simulator,
        "simulator_code": code_of(plan.simulator),
        "fixed": files.canonical(plan.fixed),
        "origin": "simulated",
    }
    return xr.Dataset(variables, coordinates, attributes)
