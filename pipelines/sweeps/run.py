"""Run a sweep block by block, so that a stopped sweep can resume."""

import contextlib
import hashlib
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from labpipe import files
from labpipe.errors import LabpipeError, UsageError
from labpipe.notebook import html_table
from labpipe.variables import described, variable
from labpipe.workflow import code
from labpipe.workflow.engines import Died, Engine, Serial, side_by_side
from pipelines.simulator_inputs import material
from pipelines.sweeps.grid import DRAW, Design
from pipelines.sweeps.parameters import Outputs, Value
from pipelines.sweeps.simulators import SIMULATORS

if TYPE_CHECKING:
    import xarray as xr

Outcome = Outputs | str
"""Numbers of a point, or the reason why there are none."""
Block = Sequence[Mapping[str, Value]]

BLOCK = 25
"""Points handed to a worker at a time: about a second of work, small against a restart."""
MOST_BLOCKS = 4000
"""Larger sweeps have larger blocks: each is a file, flushed to the disk while workers wait."""
COMPUTE = f"{__name__}:compute"
_IMPORTS = ("numpy", "xarray", "labpipe.contact", "pipelines.sweeps.simulators")


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

    @property
    def page(self) -> Path:
        """The page that the verb writes beside the file."""
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


def run_design(
    plan: Design, out: str | Path, engine: Engine | None = None, *, progress: Callable[[float], None] | None = None
) -> Swept:
    """Simulate every point of a design.

    Blocks that are done lie in ``OUT.parts`` until the sweep is complete; run again, only what is
    missing, damaged or failed is computed. The file does not depend on the engine, on the number
    of workers or on interruptions: the same points give the same bytes.

    Without an engine (:mod:`labpipe.workflow.engines`) all is done here; the other arguments, and what
    is raised, are those of :func:`pipelines.sweeps.sweep`.
    """
    path = Path(out)
    if path.suffix != ".nc":
        raise UsageError(f"{path}: the result of a sweep is a netCDF file; give a name that ends in .nc")
    parts = path.with_name(f"{path.stem}.parts")
    blocks, results = _Blocks.of(plan), _Results(plan)
    for key in blocks:
        outcome = _kept(parts, key, blocks.length(key))
        if outcome is not None:
            results.take(key, blocks, outcome)
    reused = results.n_known
    missing = blocks.without(results)
    found = side_by_side(engine or Serial(), COMPUTE, missing, imports=_IMPORTS)
    for key, answer in found:
        lost = isinstance(answer, Died)
        outcome = [str(answer)] * blocks.length(key) if lost else answer
        files.write_bytes(parts / f"{key}.json", files.seal(outcome))
        results.take(key, blocks, outcome)
        if progress is not None:
            progress(results.n_known / plan.count)
    dataset = results.dataset()
    files.write_dataset(path, dataset)
    failed = len(results.problems)
    if not failed and parts.is_dir():
        shutil.rmtree(parts)
    return Swept(path, dataset, plan.count - reused, reused, failed)


def compute(simulator: str, block: Block) -> list[Outcome]:
    """Simulate the points of a block; a point that fails is its message."""
    run, together = SIMULATORS[simulator].run, SIMULATORS[simulator].together
    if together is not None:
        # Where one point has no answer all are asked again, one by one: it is told which.
        with contextlib.suppress(Exception):
            return [*together(block)]
    found: list[Outcome] = []
    for point in block:
        try:
            found.append(run(point))
        # A point of a map may lie where there is no answer: that is told and the others go on.
        except Exception as error:
            found.append(f"{type(error).__name__}: {error}")
    return found


@dataclass(frozen=True, slots=True)
class _Blocks(Mapping[str, tuple[str, Block]]):
    """What to compute, by content key; spelt out when asked for, a sweep may have many points."""

    plan: Design
    size: int
    places: dict[str, list[int]]

    @classmethod
    def of(cls, plan: Design) -> "_Blocks":
        contents: dict[str, str] = {}
        places: dict[str, list[int]] = {}
        size = max(BLOCK, ceil(plan.count / MOST_BLOCKS))
        for start in range(0, plan.count, size):
            key = _key(plan.simulator, plan.points(start, start + size), contents)
            places.setdefault(key, []).append(start)
        return cls(plan, size, places)

    def without(self, results: "_Results") -> "_Blocks":
        """Return those whose results are not known."""
        missing = {k: p for k, p in self.places.items() if not results.is_known[p[0]]}
        return _Blocks(self.plan, self.size, missing)

    def __getitem__(self, key: str) -> tuple[str, Block]:
        start = self.places[key][0]
        return self.plan.simulator, self.plan.points(start, start + self.size)

    def length(self, key: str) -> int:
        """Points of a block; the last one may be shorter."""
        return min(self.size, self.plan.count - self.places[key][0])

    def __iter__(self) -> Iterator[str]:
        return iter(self.places)

    def __len__(self) -> int:
        return len(self.places)


class _Results:
    """What is known of every point: numbers, or why there are none."""

    def __init__(self, plan: Design) -> None:
        self.plan = plan
        self.is_known = np.zeros(plan.count, dtype=bool)
        self.values = {name: np.full(plan.count, np.nan) for name in SIMULATORS[plan.simulator].outputs}
        self.problems: dict[int, str] = {}

    @property
    def n_known(self) -> int:
        """Points with an outcome."""
        return int(np.count_nonzero(self.is_known))

    def take(self, key: str, blocks: _Blocks, outcomes: list[Outcome]) -> None:
        """Take the outcomes of a block, at every place where it stands in the grid.

        Raises
        ------
        LabpipeError
            It was taken before, or is not as long as the block: a defect of the program.
        """
        for start in blocks.places[key]:
            stop = min(start + blocks.size, self.plan.count)
            if self.is_known[start:stop].any() or len(outcomes) != stop - start:
                raise LabpipeError(f"points {start} to {stop}: {len(outcomes)} results, or a second time")
            self.is_known[start:stop] = True
            for point, outcome in enumerate(outcomes, start):
                if isinstance(outcome, str):
                    self.problems[point] = outcome
                else:
                    for name, values in self.values.items():
                        values[point] = outcome[name]

    def dataset(self) -> "xr.Dataset":
        """Return all results over the named dimensions.

        Raises
        ------
        LabpipeError
            A point is missing: a defect of the program.
        """
        if not self.is_known.all():
            raise LabpipeError(f"{self.plan.count - self.n_known} points of the sweep have no outcome")
        return _dataset(self.plan, self.values, self.problems)


@cache
def code_of(simulator: str) -> str:
    """Return a digest of the code that a simulator belongs to."""
    function = SIMULATORS[simulator].run
    return code.behind(f"{function.__module__}:{function.__name__}").digest


def _key(simulator: str, block: Block, contents: dict[str, str]) -> str:
    points = []
    for point in block:
        name = str(point["material"])
        if name not in contents:
            # the name of a material alone does not say what was simulated
            solid = material(name)
            numbers = [solid.E_relaxed, solid.E.tolist(), solid.rho.tolist(), solid.nu]
            contents[name] = hashlib.sha256(files.canonical(numbers).encode()).hexdigest()
        points.append({**point, "material": contents[name]})
    content = [code_of(simulator), points]
    return hashlib.sha256(files.canonical(content).encode()).hexdigest()


def _kept(parts: Path, key: str, size: int) -> list[Outcome] | None:
    """Outcomes of an earlier run; none when missing, damaged, or when a point failed."""
    path = parts / f"{key}.json"
    outcome = files.unseal(path.read_bytes()) if path.is_file() else None
    if not isinstance(outcome, list) or len(outcome) != size:
        return None
    return None if any(isinstance(one, str) for one in outcome) else outcome


def _dataset(plan: Design, values: Mapping[str, NDArray[np.float64]], reasons: Mapping[int, str]) -> "xr.Dataset":
    import xarray as xr

    simulator = SIMULATORS[plan.simulator]
    variables: dict[str, Any] = {
        name: variable(plan.dims, values[name].reshape(plan.shape), unit, text)
        for name, (unit, text) in simulator.outputs.items()
    }
    problems = np.full(plan.count, "", dtype=object)
    for point, reason in reasons.items():
        problems[point] = reason
    variables["problem"] = variable(
        plan.dims, problems.reshape(plan.shape), "1", "Why a point has no result; empty when it has"
    )
    coordinates: dict[str, Any] = {
        axis.name: variable(
            axis.name,
            np.array(axis.values),
            simulator.parameters[axis.name].unit or "1",
            axis.name.replace("_", " ").capitalize(),
        )
        for axis in plan.axes
    }
    for name, draws in plan.drawn.items():
        labels = described(simulator.parameters[name].unit, f"Drawn {name}")
        coordinates[name] = (DRAW, np.array(draws), labels)
    attributes: dict[str, Any] = {
        "simulator": plan.simulator,
        "simulator_code": code_of(plan.simulator),
        "fixed": files.canonical(plan.fixed),
        "origin": "simulated",
    }
    return xr.Dataset(variables, coordinates, attributes)
