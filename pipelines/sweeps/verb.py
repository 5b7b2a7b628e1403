"""The verb sweep: a map of the simulator, its netCDF file and its page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from labpipe import files
from labpipe.workflow.engines import choose, processors
from pipelines.sweeps.grid import axis, design
from pipelines.sweeps.page import render
from pipelines.sweeps.run import Swept, run_design


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
    simulator : {"drop", "indent", "adhesion", "heating", "amplitude"}
    out : path-like
        netCDF file; the page lies beside it.
    vary : mapping
        Values of swept parameters: ``{"height": "1 mm : 10 mm : 7"}``, with ``: log`` for equal
        ratios, or a list ``{"material": "acrylic, ptfe"}``.
    fixed : mapping
        Other parameters, ``{"radius": "9.525 ± 0.005 mm"}``, or numbers in SI.
    draws : int
        Random draws, per point, of what is given with an uncertainty.
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
    axes = [axis(simulator, name, text) for name, text in (vary or {}).items()]
    plan = design(simulator, axes, fixed, draws=draws, seed=seed)
    engine = choose((jobs or processors()) if jobs != 1 else 0, cluster)
    swept = run_design(plan, out, engine, progress=progress)
    files.write_text(swept.page, render(plan, swept))
    return swept
