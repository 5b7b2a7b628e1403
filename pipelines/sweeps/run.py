"""Run a sweep: what is done is kept block by block, so that a sweep that stopped goes on."""

import hashlib
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from labpipe import files
from labpipe.errors import UsageError
from pipelines.simulator_inputs import material
from pipelines.sweeps.engines import Block, Engine, Outcome, Serial
from pipelines.sweeps.grid import DRAW, Design
from pipelines.sweeps.simulators import SIMULATORS

if TYPE_CHECKING:
    import xarray as xr

BLOCK = 25
"""Points handed to a worker at a time: about a second of work, small against a restart."""
_FORMAT = 1


@dataclass(frozen=True, slots=True)
class Swept:
    """A finished sweep.

    Attributes
    ----------
    path : Path
        The netCDF file.
    dataset : Dataset
        Its content: every output over the named dimensions, ``problem`` where a point failed.
    computed, reused, failed : int
        Points computed now, taken from an earlier run, and without result.
    """

    path: Path
    dataset: "xr.Dataset"
    computed: int
    reused: int
    failed: int


def sweep(
    plan: Design,
    out: str | Path,
    engine: Engine | None = None,
    *,
    progress: Callable[[float], None] | None = None,
) -> Swept:
    """Simulate every point of a design.

    Blocks that are done lie in ``OUT.parts`` until the sweep is complete; run again, only what is
    missing, damaged or failed is computed. The file does not depend on the engine, on the number
    of workers or on interruptions: the same points give the same bytes.

    Parameters
    ----------
    plan : Design
        See :func:`pipelines.sweeps.design`.
    out : path-like
        netCDF file to write.
    engine : Engine, optional
        Default :class:`Serial`.
    progress : callable, optional
        Called with the fraction of the points that is done.

    Returns
    -------
    Swept

    Raises
    ------
    UsageError
        ``out`` is no netCDF name.
    StorageError
        It cannot be written.
    """
    path = Path(out)
    if path.suffix != ".nc":
        message = f"{path}: the result of a sweep is a netCDF file; give a name that ends in .nc"
        raise UsageError(message)
    parts = path.with_name(f"{path.stem}.parts")
    points = plan.points()
    materials = _materials(points)
    blocks = {
        _key(plan.simulator, block, materials): block
        for block in (points[i : i + BLOCK] for i in range(0, len(points), BLOCK))
    }
    found = {key: _kept(parts, key, block) for key, block in blocks.items()}
    missing = {key: block for key, block in blocks.items() if found[key] is None}
    reused = len(points) - sum(map(len, missing.values()))
    done = reused
    for key, outcome in (engine or Serial()).run(plan.simulator, missing):
        files.write_bytes(parts / f"{key}.json", files.seal(outcome))
        found[key] = outcome
        done += len(outcome)
        if progress is not None:
            progress(done / len(points))
    outcomes = [outcome for key in blocks for outcome in found[key] or ()]
    dataset = _dataset(plan, outcomes)
    files.write_dataset(path, dataset)
    failed = sum(isinstance(outcome, str) for outcome in outcomes)
    if not failed and parts.is_dir():
        shutil.rmtree(parts)
    return Swept(path, dataset, len(points) - reused, reused, failed)


def _materials(points: Block) -> dict[str, str]:
    """Numbers behind every material: its name alone does not say what was simulated."""
    contents = {}
    for name in sorted({str(point["material"]) for point in points}):
        solid = material(name)
        numbers = [solid.E_relaxed, solid.E.tolist(), solid.rho.tolist(), solid.nu]
        contents[name] = files.canonical(numbers)
    return contents


def _key(simulator: str, block: Block, materials: dict[str, str]) -> str:
    points = [{**point, "material": materials[str(point["material"])]} for point in block]
    content = [_FORMAT, simulator, SIMULATORS[simulator].version, points]
    return hashlib.sha256(files.canonical(content).encode()).hexdigest()


def _kept(parts: Path, key: str, block: Block) -> list[Outcome] | None:
    """Outcomes of an earlier run; none when missing, damaged, or when a point failed."""
    path = parts / f"{key}.json"
    outcome = files.unseal(path.read_bytes()) if path.is_file() else None
    if not isinstance(outcome, list) or len(outcome) != len(block):
        return None
    return None if any(isinstance(one, str) for one in outcome) else outcome


def _dataset(plan: Design, outcomes: list[Outcome]) -> "xr.Dataset":
    import xarray as xr

    simulator = SIMULATORS[plan.simulator]
    variables: dict[str, Any] = {}
    for name, (unit, text) in simulator.outputs.items():
        values = [np.nan if isinstance(o, str) else o[name] for o in outcomes]
        variables[name] = (
            plan.dims, np.array(values, float).reshape(plan.shape),
            {"units": unit, "long_name": text},
        )  # fmt: skip
    problems = np.array([o if isinstance(o, str) else "" for o in outcomes], dtype=object)
    variables["problem"] = (
        plan.dims, problems.reshape(plan.shape),
        {"units": "1", "long_name": "Why a point has no result; empty when it has"},
    )  # fmt: skip
    coordinates: dict[str, Any] = {
        axis.name: (
            axis.name, np.array(axis.values),
            {"units": simulator.parameters[axis.name].unit or "1",
             "long_name": axis.name.replace("_", " ").capitalize()},
        )
        for axis in plan.axes
    }  # fmt: skip
    for name, draws in plan.drawn.items():
        labels = {"units": simulator.parameters[name].unit, "long_name": f"Drawn {name}"}
        coordinates[name] = (DRAW, np.array(draws), labels)
    attributes: dict[str, Any] = {
        "simulator": plan.simulator,
        "simulator_version": simulator.version,
        "fixed": files.canonical(plan.fixed),
        "origin": "simulated",
    }
    return xr.Dataset(variables, coordinates, attributes)
