"""One simulation of a periodic indentation: choice of solver, recorded output, result."""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from threadpoolctl import ThreadpoolController

from labpipe.arrays import Floats
from labpipe.contact.line._kernels import LineKernel, line_kernel
from labpipe.contact.line._profiles import is_symmetric, sampled_heights, strip_heights
from labpipe.contact.line._strips import line_bed, line_pressure
from labpipe.contact.memory import Creep
from labpipe.contact.springs import Control, March, NotNestedError, State
from labpipe.errors import InputError
from labpipe.materials import Prony
from labpipe.variables import variable

Output = Literal["pressure", "surface", "energy"]

DEFAULT_ELEMENTS = 1024
"""Strips per period: the elastic force is then good to 4e-6 from a half width of λ/50 on."""

DEFAULT_RTOL = 1e-4
"""Error of the force over the history, relative to the largest; with a pressed load, of the approach."""

_OUTPUTS = ("pressure", "surface", "energy")
# Maps larger than this are a mistake more often than a wish.
_MAX_MAP_BYTES = 2 << 30
_PRESSURE_ROUNDING = 1e-6
# Progress is reported once in so many samples.
_PROGRESS_EVERY = 20
# So many strips go without the threads of the linear algebra: they gain nothing there, and where all
# processors are busy a factor of 128 strips waited for them for 20 times its own time.
_BY_ONE_THREAD = 1200


@dataclass(frozen=True, slots=True)
class Request:
    """What is pressed into what."""

    material: Prony
    tip_radius: float
    period: float
    depth: float
    profile: str | ArrayLike
    thickness: float
    elements: int | None


@dataclass(frozen=True, slots=True)
class _Geometry:
    """One period of the indenter over its surface."""

    kernel: LineKernel
    heights: Floats
    is_smooth: bool
    limit: str


def simulate(
    request: Request,
    time: Floats,
    value: Floats,
    control: Control,
    rtol: float | None,
    outputs: Sequence[Output],
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """March through a checked history; see :func:`labpipe.contact.indent`.

    ``request``: what is pressed into what; ``time`` (time,) [s]: never falling; ``value`` (time,) [m or N]:
    displacement, or load; ``control``: which of the two; ``rtol``, ``outputs``, ``progress``: as of
    :func:`labpipe.contact.indent`.
    """
    _require_known(request, rtol, outputs, time.size)
    is_small = (request.elements or DEFAULT_ELEMENTS) <= _BY_ONE_THREAD
    with _libraries().limit(limits=1 if is_small else None, user_api="blas"):
        creep = Creep.of(request.material)
        geometry = _geometry(request, value if control == "displacement" else None)
        values = value if control == "displacement" else value / request.depth
        settings = (creep, control, rtol, "energy" in outputs)
        _require_nested(geometry)
        run = _spring_run(geometry, values, settings)
        try:
            rows = _record(run, geometry.kernel, time, values, outputs, progress)
        except NotNestedError:
            raise InputError(
                f"at {time[run.march.samples_done]:g} s the contact stops being one growing and shrinking strip about "
                "the centre of the period, which the springs of this solver cannot follow; give a smaller rtol, or a "
                "profile that touches from its centre outwards"
            ) from None
        return _dataset(run, rows, request, time, geometry.kernel)


@cache
def _libraries() -> ThreadpoolController:
    """Libraries with threads of their own, which take 10 ms to find."""
    return ThreadpoolController()


@dataclass(frozen=True, slots=True)
class _Run:
    """Springs ready to march, and how their loads become pressures over the period."""

    march: March
    pressure: Callable[[Floats], Floats]


def _spring_run(geometry: _Geometry, value: Floats, settings: tuple[Creep, Control, float | None, bool]) -> _Run:
    # The strip at half a period is stored once, at index 0.
    half = np.append(geometry.heights[geometry.heights.size // 2 :], geometry.heights[0])
    present = np.isfinite(half)
    half = half if present.all() else half[: int(np.argmin(present))]
    reach = float(value.max()) if settings[1] == "displacement" else np.inf
    kernel = geometry.kernel
    bed, folded = line_bed(
        kernel,
        half,
        reach,
        is_smooth=geometry.is_smooth,
        has_end=not geometry.is_smooth and not present.all(),
        limit=geometry.limit,
    )
    return _Run(March(bed, *settings), lambda load: line_pressure(kernel, folded, load))


def _require_known(request: Request, rtol: float | None, outputs: Sequence[Output], n_times: int) -> None:
    if not (np.isfinite(request.depth) and request.depth > 0.0):
        raise InputError(f"the depth (contact length) is {request.depth} m, expected a positive length")
    if rtol is not None and not 1e-8 <= rtol <= 0.1:
        raise InputError(f"rtol is {rtol}, expected 1e-8 to 0.1, or None for one step per sample")
    unknown = [name for name in outputs if name not in _OUTPUTS]
    if unknown:
        raise InputError(f'output "{unknown[0]}" is unknown; use any of {", ".join(_OUTPUTS)}')
    n_maps = sum(name in outputs for name in ("pressure", "surface"))
    n_bytes = n_maps * n_times * (request.elements or DEFAULT_ELEMENTS) * 8
    if n_bytes > _MAX_MAP_BYTES:
        raise InputError(
            f"the maps of {n_times} samples would take {n_bytes / 2**30:.1f} GiB; request them "
            f"for a part of the history or with fewer elements"
        )


def _geometry(request: Request, displacement: Floats | None) -> _Geometry:
    named = isinstance(request.profile, str)
    sampled = None if named else sampled_heights(request.profile)
    elements = request.elements or (DEFAULT_ELEMENTS if sampled is None else sampled.size)
    if sampled is not None and sampled.size != elements:
        raise InputError(f"the profile has {sampled.size} heights but elements is {elements}")
    nu = request.material.nu
    kernel = line_kernel(request.period, elements, request.thickness, nu)
    if displacement is not None and displacement.max() >= request.thickness:
        n = int(np.argmax(displacement))
        raise InputError(
            f"displacement[{n}] is {displacement[n]:.4g} m, more than the layer's thickness of "
            f"{request.thickness:.4g} m"
        )
    if isinstance(request.profile, str):
        heights = strip_heights(request.profile, request.tip_radius, request.period, elements)
    else:
        heights = sampled if sampled is not None else np.empty(0)
    limit = _limit_text(kernel, heights, request)
    if displacement is not None and kernel.mean_compliance == 0.0:
        _require_below_full_contact(heights, displacement, limit)
    return _Geometry(kernel, heights, named, limit)


def _limit_text(kernel: LineKernel, heights: Floats, request: Request) -> str:
    if kernel.mean_compliance == 0.0 and np.all(np.isfinite(heights)):
        return (
            f"the contact closes over the whole period: a half-plane cannot be pressed by "
            f"{heights.mean():.4g} m or more by this profile; reduce the displacement, give the "
            "layer's thickness, or more elements if the contact is meant to be nearly full"
        )
    return (
        f"the contact reaches the end of the indenter (radius {request.tip_radius:.4g} m, period "
        f"{request.period:.4g} m); reduce the displacement"
    )


def _require_below_full_contact(heights: Floats, displacement: Floats, limit: str) -> None:
    beyond = np.flatnonzero(displacement >= heights.mean())
    if beyond.size:
        n = beyond[0]
        raise InputError(f"displacement[{n}] is {displacement[n]:.4g} m: {limit}")


def _require_nested(geometry: _Geometry) -> None:
    """Refuse a profile whose contact does not grow from the centre of the period outwards."""
    heights = geometry.heights
    if not is_symmetric(heights):
        raise InputError("the profile is not symmetric about the centre of the period, index N/2: give one that is")
    if heights[heights.size // 2] > heights.min():
        raise InputError("the profile is not lowest at its centre, index N/2: shift it by a part of a period")


def _record(
    run: _Run,
    kernel: LineKernel,
    time: Floats,
    value: Floats,
    outputs: Sequence[Output],
    progress: Callable[[float], None] | None,
) -> dict[str, Floats]:
    """March through the history and keep what is asked for, one row per sample."""
    names = ["displacement", "force", "contact_half_width"]
    if "energy" in outputs:
        names += ["work_done", "stored_energy", "dissipated_energy"]
    rows = {name: np.empty(time.size) for name in names}
    maps = [name for name in ("pressure", "surface") if name in outputs]
    rows |= {name: np.empty((time.size, kernel.elements)) for name in maps}
    for n, state in enumerate(run.march.run(time, value)):
        for name, number in _row(run, kernel, state, rows.keys()).items():
            rows[name][n] = number
        if progress is not None and n % _PROGRESS_EVERY == 0:
            progress((n + 1) / time.size)
    return rows


def _row(run: _Run, kernel: LineKernel, state: State, names: Iterable[str]) -> dict[str, Floats | float]:
    answer = state.answer
    row: dict[str, Floats | float] = {
        "displacement": answer.displacement,
        "force": answer.force,
        "contact_half_width": answer.half_width,
    }
    if "work_done" in names:
        row["work_done"] = state.work
        row["stored_energy"] = run.march.stored(state)
        row["dissipated_energy"] = state.dissipated
    if "pressure" in names:
        row["pressure"] = _not_negative(run.pressure(answer.load))
    if "surface" in names:
        strain = run.march.creep.instantaneous * answer.load + state.memory.sum(axis=0)
        row["surface"] = kernel.displacement(run.pressure(strain))
    return row


def _not_negative(pressure: Floats) -> Floats:
    """Remove rounding below zero; anything larger is a defect and is said so."""
    if pressure.min() < -_PRESSURE_ROUNDING * float(pressure.max()):
        raise InputError(
            f"a negative pressure of {pressure.min():.3g} Pa was found against a largest of "
            f"{pressure.max():.3g} Pa; use more elements"
        )
    return np.maximum(pressure, 0.0)


_VARIABLES = {
    "displacement": ("m", "Approach of the indenter"),
    "force": ("N", "Normal force"),
    "contact_half_width": ("m", "Half of the contact length of one period"),
    "work_done": ("J", "Work done by the indenter"),
    "stored_energy": ("J", "Elastically stored energy"),
    "dissipated_energy": ("J", "Dissipated energy"),
    "pressure": ("Pa", "Contact pressure"),
    "surface": ("m", "Displacement of the surface into the body"),
}
_PER_DEPTH = ("force", "work_done", "stored_energy", "dissipated_energy")


def _dataset(run: _Run, rows: dict[str, Floats], request: Request, time: Floats, kernel: LineKernel) -> xr.Dataset:
    variables: dict[str, Any] = {}
    for name, values in rows.items():
        units, text = _VARIABLES[name]
        dims = ("time", "x") if values.ndim == 2 else ("time",)
        scaled = values * request.depth if name in _PER_DEPTH else values
        variables[name] = variable(dims, scaled, units, text)
    coordinates: dict[str, Any] = {}
    coordinates["time"] = variable("time", time, "s", "Time")
    if any(values.ndim == 2 for values in rows.values()):
        first = -(kernel.elements // 2)
        x = kernel.spacing * np.arange(first, first + kernel.elements, dtype=float)
        coordinates["x"] = variable("x", x, "m", "Position along the period")
    march = run.march
    counts = {
        "solver_steps": march.ledger.steps,
        "rejected_steps": march.ledger.rejected_steps,
        "solves": march.ledger.solves,
        "unknowns": march.contact.size,
        "elements": kernel.elements,
        "terms": march.creep.n_terms,
    }
    attributes: dict[str, str | float] = {
        "solver": "springs",
        "solver_reason": "nested contact",
        "datum": kernel.datum,
        "profile": request.profile if isinstance(request.profile, str) else "array",
        "work": json.dumps(counts),
    }
    if "work_done" in rows:
        attributes["energy_error"] = _energy_error(rows)
    return xr.Dataset(variables, coordinates, attributes)


def _energy_error(rows: dict[str, Floats]) -> float:
    """Largest numerical energy error of the time steps, relative to the largest energy."""
    error = rows["work_done"] - rows["stored_energy"] - rows["dissipated_energy"]
    largest = max(float(np.abs(rows[name]).max()) for name in ("work_done", "stored_energy"))
    return float(np.abs(error).max()) / max(largest, np.finfo(float).tiny)
