r"""Indentation of a viscoelastic half-plane or bonded layer by a periodic row of tips.

Thesis chapter 2, with another time integration than its eqs. (2.13) to (2.15): the hereditary
integral of a Prony series is exact by a recursion whose cost does not grow with the history (R. L.
Taylor, K. S. Pister, G. L. Goudreau, 1970, https://doi.org/10.1002/nme.1620020106;
:mod:`labpipe.contact.memory`), and a nested contact needs no linear solve
(:mod:`labpipe.contact.springs`).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from threadpoolctl import ThreadpoolController

from labpipe.arrays import Floats
from labpipe.contact.line._kernels import LineKernel, line_kernel
from labpipe.contact.line._profiles import strip_heights
from labpipe.contact.line._strips import FoldedLine, line_bed, line_pressure
from labpipe.contact.memory import Creep, checked_history, checked_load
from labpipe.contact.springs import Control, March, NotNestedError, State
from labpipe.errors import InputError
from labpipe.materials import Solid, solid
from labpipe.units import Measure, require_positive, si
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


def indent(
    material: Solid,
    tip_radius: Measure,
    period: Measure,
    depth: Measure,
    time: ArrayLike,
    displacement: ArrayLike,
    profile: str = "parabola",
    thickness: Measure = np.inf,
    elements: int = DEFAULT_ELEMENTS,
    *,
    rtol: float | None = DEFAULT_RTOL,
    outputs: Sequence[Output] = (),
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Press a periodic row of tips into a viscoelastic surface by a prescribed displacement.

    Lengths are numbers in SI or texts with a unit, ``"2 mm"``.

    Parameters
    ----------
    material : Prony, or str
        Viscoelastic solid, or its name; no terms is an elastic one.
    tip_radius : float [m]
        Radius of curvature R of a tip.
    period : float [m]
        Distance λ between tips.
    depth : float [m]
        Out-of-plane contact length, summed over the tips: forces are line force times depth.
    time : array (time,) [s]
        Irregular as you like, never falling; two samples at one time are a jump. The surface is
        undeformed before the first sample; a first displacement in contact is a jump.
    displacement : array (time,) [m]
        Approach, positive into the surface, from first touch of the undeformed surface; linear
        between the samples. Negative is out of contact.
    profile : "parabola", "circle" or "cosine"
        Shape of a tip. Parabola and circle differ by 0.7 % in force at δ = R/10.
    thickness : float [m]
        Of the layer bonded to a rigid base; infinite for the half-plane.
    elements : int, optional
        Strips per period, even.
    rtol : float or None
        Error to aim at, over the largest force (or approach, by load); steps adapt, at least two
        between samples. None takes one step whatever their distance.
    outputs : sequence of {"pressure", "surface", "energy"}
        Further variables.
    progress : callable, optional
        Called now and then with the fraction of the samples that is done.

    Returns
    -------
    Dataset
        Over ``time``: ``displacement`` [m], ``force`` [N], ``contact_half_width`` [m] (half of the
        total contact length of a period). On request ``pressure`` [Pa], ``surface`` [m] (positive
        into the body) over (``time``, ``x``); ``work_done``, ``stored_energy``,
        ``dissipated_energy`` [J]. Attributes: ``work`` (JSON counts), ``solver``,
        ``datum`` of displacements ("mean surface" or "rigid base (absolute)"),
        and with energies ``energy_error``: the largest difference of the work done and the
        stored and dissipated energy, relative to the work: the error of the steps in time.

    Raises
    ------
    InputError
        A value lies outside its domain, the history has a gap or runs backwards, a
        half-plane would be in full contact, a circle in contact at ``|x| = R``, or the contact
        does not grow and shrink from the centre of the period.

    Notes
    -----
    Constant Poisson's ratio, no friction, no adhesion, small slopes. A half-plane's approach is
    relative to the mean surface, because its mean displacement is not defined.

    References
    ----------
    Thesis eqs. (2.7)-(2.16).

    Examples
    --------
    >>> from labpipe.materials import Prony
    >>> rubber = Prony(7.6e6, [], [], nu=0.5)
    >>> result = indent(rubber, 2e-3, 8e-3, 18e-3, [0.0], [1e-4], profile="cosine")
    >>> round(float(result.force[0]), 1)
    12.4
    """
    times, values = checked_history(time, displacement, "displacement")
    lengths = {"tip_radius": tip_radius, "period": period, "depth": depth, "thickness": thickness}
    return _simulate(material, lengths, times, values, "displacement", profile, elements, rtol, outputs, progress)


def indent_load(
    material: Solid,
    tip_radius: Measure,
    period: Measure,
    depth: Measure,
    time: ArrayLike,
    load: ArrayLike,
    profile: str = "parabola",
    thickness: Measure = np.inf,
    elements: int = DEFAULT_ELEMENTS,
    *,
    rtol: float | None = DEFAULT_RTOL,
    outputs: Sequence[Output] = (),
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Press a periodic row of tips into a viscoelastic surface by a prescribed load.

    Parameters
    ----------
    load : array (time,) [N]
        Compressive load, at least 0, linear between the samples; a first load above 0 is a jump.

    Returns
    -------
    Dataset
        As :func:`indent`; ``displacement`` is the solution. Without load it is where the tip just
        touches the recovering surface.

    Raises
    ------
    InputError
        As :func:`indent`; or a load is negative.

    See Also
    --------
    indent : all other parameters, and the same run by displacement.

    Examples
    --------
    >>> from labpipe.materials import Prony
    >>> rubber = Prony(7.6e6, [], [], nu=0.5)
    >>> result = indent_load(rubber, 2e-3, 8e-3, 18e-3, [0.0], [12.4], profile="cosine")
    >>> round(float(result.displacement[0]) * 1e3, 3)
    0.1
    """
    times, values = checked_load(time, load)
    lengths = {"tip_radius": tip_radius, "period": period, "depth": depth, "thickness": thickness}
    return _simulate(material, lengths, times, values, "force", profile, elements, rtol, outputs, progress)


class _Line(NamedTuple):
    """Surface, factored half period, contact length [m] and shape of the tips."""

    kernel: LineKernel
    folded: FoldedLine
    depth: float
    profile: str


def _simulate(
    material: Solid,
    lengths: dict[str, Measure],
    time: Floats,
    value: Floats,
    control: Control,
    profile: str,
    elements: int,
    rtol: float | None,
    outputs: Sequence[Output],
    progress: Callable[[float], None] | None,
) -> xr.Dataset:
    """March through a checked history of displacement [m] or load [N]."""
    body = solid(material)
    radius, period, depth, thickness = (si(given, "m", name) for name, given in lengths.items())
    require_positive("m", depth=depth)
    if rtol is not None and not 1e-8 <= rtol <= 0.1:
        raise InputError(f"rtol is {rtol}, expected 1e-8 to 0.1, or None for one step per sample")
    if unknown := [name for name in outputs if name not in _OUTPUTS]:
        raise InputError(f'output "{unknown[0]}" is unknown; use any of {", ".join(_OUTPUTS)}')
    n_bytes = sum(name != "energy" for name in outputs) * time.size * elements * 8
    if n_bytes > _MAX_MAP_BYTES:
        raise InputError(
            f"the maps of {time.size} samples would take {n_bytes / 2**30:.1f} GiB; request them "
            f"for a part of the history or with fewer elements"
        )
    with _libraries().limit(limits=1 if elements <= _BY_ONE_THREAD else None, user_api="blas"):
        kernel = line_kernel(period, elements, thickness, body.nu)
        heights = strip_heights(profile, radius, period, elements)
        limit = _limit_text(kernel, heights, radius)
        reach, values = np.inf, value / depth
        if control == "displacement":
            _require_possible(value, thickness, kernel, heights, limit)
            reach, values = float(value.max()), value
        # The strip at half a period is stored once, at index 0; a circle ends before.
        half = np.append(heights[elements // 2 :], heights[0])
        bed, folded = line_bed(kernel, half[np.isfinite(half)], reach, limit)
        march = March(bed, Creep.of(body), control, rtol, "energy" in outputs)
        line = _Line(kernel, folded, depth, profile)
        try:
            rows = _record(march, line, time, values, outputs, progress)
        except NotNestedError:
            raise InputError(
                f"at {time[march.samples_done]:g} s the contact stops being one growing and shrinking strip about "
                "the centre of the period, which the springs of this solver cannot follow; give a smaller rtol or "
                "more samples"
            ) from None
        return _dataset(march, rows, time, line)


@cache
def _libraries() -> ThreadpoolController:
    """Libraries with threads of their own, which take 10 ms to find."""
    return ThreadpoolController()


def _limit_text(kernel: LineKernel, heights: Floats, tip_radius: float) -> str:
    if kernel.mean_compliance == 0.0 and np.all(np.isfinite(heights)):
        return (
            f"the contact closes over the whole period: a half-plane cannot be pressed by "
            f"{heights.mean():.4g} m or more by this profile; reduce the displacement, give the "
            "layer's thickness, or more elements if the contact is meant to be nearly full"
        )
    return (
        f"the contact reaches the end of the indenter (radius {tip_radius:.4g} m, period "
        f"{kernel.period:.4g} m); reduce the displacement"
    )


def _require_possible(displacement: Floats, thickness: float, kernel: LineKernel, heights: Floats, limit: str) -> None:
    """Refuse displacements beyond the layer, or that close the contact of a half-plane."""
    n = int(np.argmax(displacement))
    if displacement[n] >= thickness:
        raise InputError(
            f"displacement[{n}] is {displacement[n]:.4g} m, more than the layer's thickness of {thickness:.4g} m"
        )
    beyond = np.flatnonzero(displacement >= heights.mean())
    if kernel.mean_compliance == 0.0 and beyond.size:
        raise InputError(f"displacement[{beyond[0]}] is {displacement[beyond[0]]:.4g} m: {limit}")


def _record(
    march: March,
    line: _Line,
    time: Floats,
    value: Floats,
    outputs: Sequence[Output],
    progress: Callable[[float], None] | None,
) -> dict[str, Floats]:
    """March through the history and keep the requested outputs, one row per sample."""
    names = ["displacement", "force", "contact_half_width"]
    if "energy" in outputs:
        names += ["work_done", "stored_energy", "dissipated_energy"]
    rows = {name: np.empty(time.size) for name in names}
    maps = [name for name in ("pressure", "surface") if name in outputs]
    rows |= {name: np.empty((time.size, line.kernel.elements)) for name in maps}
    for n, state in enumerate(march.run(time, value)):
        for name, number in _row(march, line, state, rows.keys()).items():
            rows[name][n] = number
        if progress is not None and n % _PROGRESS_EVERY == 0:
            progress((n + 1) / time.size)
    return rows


def _row(march: March, line: _Line, state: State, names: Iterable[str]) -> dict[str, Floats | float]:
    answer = state.answer
    row: dict[str, Floats | float] = {
        "displacement": answer.displacement,
        "force": answer.force,
        "contact_half_width": answer.half_width,
    }
    if "work_done" in names:
        row["work_done"] = state.work
        row["stored_energy"] = march.stored(state)
        row["dissipated_energy"] = state.dissipated
    if "pressure" in names:
        row["pressure"] = _not_negative(line_pressure(line.kernel, line.folded, answer.load))
    if "surface" in names:
        strain = march.creep.instantaneous * answer.load + state.memory.sum(axis=0)
        row["surface"] = line.kernel.displacement(line_pressure(line.kernel, line.folded, strain))
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


def _dataset(march: March, rows: dict[str, Floats], time: Floats, line: _Line) -> xr.Dataset:
    kernel = line.kernel
    variables: dict[str, Any] = {}
    for name, values in rows.items():
        units, text = _VARIABLES[name]
        dims = ("time", "x") if values.ndim == 2 else ("time",)
        scaled = values * line.depth if name in _PER_DEPTH else values
        variables[name] = variable(dims, scaled, units, text)
    coordinates: dict[str, Any] = {}
    coordinates["time"] = variable("time", time, "s", "Time")
    if any(values.ndim == 2 for values in rows.values()):
        first = -(kernel.elements // 2)
        x = kernel.spacing * np.arange(first, first + kernel.elements, dtype=float)
        coordinates["x"] = variable("x", x, "m", "Position along the period")
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
        "profile": line.profile,
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
