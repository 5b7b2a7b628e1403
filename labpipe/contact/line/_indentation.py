"""Indentation of a viscoelastic half-plane or bonded layer by a periodic row of tips.

Thesis chapter 2, with another time integration than its eqs. (2.13) to (2.15): the hereditary integral of a Prony
series is exact by a recursion whose cost does not grow with the history (R. L. Taylor, K. S. Pister, G. L. Goudreau,
1970, https://doi.org/10.1002/nme.1620020106), and a nested contact needs no linear solve (:mod:`.._springs`).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.linalg import toeplitz
from threadpoolctl import ThreadpoolController

from labpipe.arrays import Floats
from labpipe.contact._memory import Creep, checked_history
from labpipe.contact._stepping import March
from labpipe.contact._thesis_scheme import ThesisScheme
from labpipe.contact.line._surface import LineKernel, line_kernel, strip_bed, tip_height
from labpipe.errors import InputError
from labpipe.materials import Solid, solid
from labpipe.units import Measure, require_positive, si
from labpipe.variables import variable

Output = Literal["pressure", "surface", "energy"]

# So many strips are factored without the threads of the linear algebra, which gain nothing and wait for each other.
_BY_ONE_THREAD = 1200
# Libraries with threads of their own, which take 10 ms to find.
_libraries = cache(ThreadpoolController)

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


def indent(
    material: Solid,
    tip_radius: Measure,
    period: Measure,
    depth: Measure,
    time: ArrayLike,
    displacement: ArrayLike,
    profile: str = "parabola",
    thickness: Measure = np.inf,
    elements: int = 1024,
    *,
    rtol: float = 1e-4,
    outputs: Sequence[Output] = (),
    progress: Callable[[float], None] | None = None,
    solver: Literal["springs", "thesis"] = "springs",
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
        Never falling; two samples at one time are a jump. A first displacement in contact is one too.
    displacement : array (time,) [m]
        Approach, positive into the surface, from first touch of the undeformed surface; linear between the samples.
    profile : "parabola", "circle" or "cosine"
        Shape of a tip. Parabola and circle differ by 0.7 % in force at δ = R/10.
    thickness : float [m]
        Of the layer bonded to a rigid base; infinite for the half-plane.
    elements : int, optional
        Strips per period, even; with 1024 the elastic force is good to 4e-6 from a half width of λ/50 on.
    rtol : float
        Error to aim at, over the largest force; steps adapt, at least two between samples.
    outputs : sequence of {"pressure", "surface", "energy"}
        Further variables.
    progress : callable, optional
        Called now and then with the fraction of the samples that is done.
    solver : {"springs", "thesis"}
        Independent springs, or as a reference the thesis's own scheme at uniform times.

    Returns
    -------
    Dataset
        Over ``time``: ``displacement`` [m], ``force`` [N], ``contact_half_width`` [m] (half of the total contact length
        of a period). On request ``pressure`` [Pa], ``surface`` [m] (positive into the body) over (``time``, ``x``);
        ``work_done``, ``stored_energy``, ``dissipated_energy`` [J]. Attributes: ``work`` (JSON counts), ``solver``,
        ``datum`` of displacements ("mean surface" or "rigid base (absolute)"), and with energies ``energy_error``, that
        of the steps in time relative to the work done.

    Raises
    ------
    InputError
        A value lies outside its domain, the history has a gap or runs backwards, a half-plane would be in full contact,
        a circle in contact at ``|x| = R``, or the contact does not grow and shrink from the centre of the period.

    Notes
    -----
    Thesis eqs. (2.7)-(2.16). Constant Poisson's ratio, no friction, no adhesion, small slopes.

    Examples
    --------
    >>> from labpipe.materials import Prony
    >>> rubber = Prony(7.6e6, [], [], nu=0.5)
    >>> result = indent(rubber, 2e-3, 8e-3, 18e-3, [0.0], [1e-4], profile="cosine")
    >>> round(float(result.force[0]), 1)
    12.4
    """
    times, values = checked_history(time, displacement, "displacement")
    line = _Line.of(material, (tip_radius, period, depth, thickness), profile, elements)
    if solver == "thesis":
        if outputs:
            raise InputError("the thesis's scheme gives force and contact half width only; leave out outputs")
        return line.by_thesis_scheme(times, values)
    if solver != "springs":
        raise InputError(f'solver is "{solver}", expected "springs" or "thesis"')
    return line.march(times, values, rtol, outputs, progress)


@dataclass(frozen=True, slots=True)
class _Line:
    """Material, strips, contact length [m], thickness [m] of the layer and shape of the tips."""

    creep: Creep
    kernel: LineKernel
    tip_radius: float
    depth: float
    thickness: float
    profile: str

    @classmethod
    def of(cls, material: Solid, lengths: tuple[Measure, ...], profile: str, elements: int) -> _Line:
        """Check a line contact, ``lengths`` being tip radius, period, depth and thickness."""
        body = solid(material)
        names = ("tip_radius", "period", "depth", "thickness")
        radius, period, depth, thickness = (si(given, "m", name) for given, name in zip(lengths, names, strict=True))
        require_positive("m", depth=depth)
        kernel = line_kernel(period, elements, thickness, body.nu)
        return cls(Creep.of(body), kernel, radius, depth, thickness, profile)

    def march(
        self,
        time: Floats,
        displacement: Floats,
        rtol: float,
        outputs: Sequence[Output],
        progress: Callable[[float], None] | None,
    ) -> xr.Dataset:
        """March through a checked history of displacement [m]."""
        kernel, elements = self.kernel, self.kernel.elements
        if not 1e-8 <= rtol <= 0.1:
            raise InputError(f"rtol is {rtol}, expected 1e-8 to 0.1")
        if unknown := [name for name in outputs if name not in ("pressure", "surface", "energy")]:
            raise InputError(f'output "{unknown[0]}" is unknown; use any of pressure, surface, energy')
        maps = [name for name in ("pressure", "surface") if name in outputs]
        heights = tip_height(self.profile, kernel.position, self.tip_radius, kernel.period, kernel.spacing)
        limit = self._limit(heights, displacement)
        rows, answers = {name: np.empty((time.size, elements)) for name in maps}, np.empty((time.size, 7))
        # The strip at half a period is stored once, at index 0; a circle ends before.
        half = np.append(heights[elements // 2 :], heights[0])
        with _libraries().limit(limits=1 if elements <= _BY_ONE_THREAD else None, user_api="blas"):
            bed = strip_bed(kernel, half[np.isfinite(half)], float(displacement.max()))
        march = March(bed.springs, self.creep, "displacement", rtol, limit)
        for n, found in enumerate(march.run(time, displacement)):
            answers[n] = found
            if "pressure" in maps:
                rows["pressure"][n] = bed.pressure(kernel, march.room.load)
            if "surface" in maps:
                moved = self.creep.instantaneous * march.room.load + march.room.memory.sum(axis=0)
                rows["surface"][n] = kernel.displacement(bed.pressure(kernel, moved))
            if progress is not None and n % max(time.size // 100, 1) == 0:
                progress((n + 1) / time.size)
        names = ("displacement", "force", "contact_half_width", "work_done", "dissipated_energy", "stored_energy")
        rows = dict(zip(names[: 6 if "energy" in outputs else 3], answers.T, strict=False)) | rows
        if "pressure" in maps:
            least, most = rows["pressure"].min(axis=1), rows["pressure"].max(axis=1)
            if np.any(least < -1e-6 * most):  # more than rounding
                raise InputError(f"a negative pressure of {least.min():.3g} Pa was found; use more elements")
            rows["pressure"] = np.maximum(rows["pressure"], 0.0)
        counts = march.counts | {"unknowns": march.contact.size}
        result = self._dataset(time, rows, counts, "springs")
        if "energy" in outputs:
            error = rows["work_done"] - rows["stored_energy"] - rows["dissipated_energy"]
            largest = max(float(np.abs(rows[name]).max()) for name in ("work_done", "stored_energy"))
            result.attrs["energy_error"] = float(np.abs(error).max()) / max(largest, np.finfo(float).tiny)
        return result

    def by_thesis_scheme(self, time: Floats, displacement: Floats) -> xr.Dataset:
        """Follow a checked history of displacement [m] by equations (2.13)-(2.16)."""
        kernel, steps = self.kernel, np.diff(time)
        step = float(steps.mean()) if steps.size else 0.0
        if steps.size and not (step > 0.0 and np.allclose(steps, step, rtol=1e-6, atol=0.0)):
            raise InputError("the thesis's scheme needs uniform time steps; resample the history")
        height = tip_height(self.profile, kernel.position, self.tip_radius, kernel.period)
        creep = self.creep.compliance(step * np.arange(time.size, dtype=float))
        scheme = ThesisScheme(toeplitz(kernel.influence), height, creep)
        force, width = np.zeros((2, time.size))
        for n, depth in enumerate(displacement):
            scheme.step(n, depth)
            force[n] = kernel.spacing * scheme.pressure.sum()
            width[n] = 0.5 * kernel.spacing * np.count_nonzero(scheme.pressure)
        rows = {"displacement": displacement, "force": force, "contact_half_width": width}
        return self._dataset(time, rows, scheme.work, "thesis")

    def _limit(self, heights: Floats, displacement: Floats) -> str:
        """Sentence on the deepest possible contact; refuse displacements that go beyond."""
        full = float(heights.mean()) if self.kernel.mean_compliance == 0.0 else np.inf
        limit = (
            f"the contact reaches the end of the indenter of radius {self.tip_radius:.4g} m; reduce the displacement"
        )
        if np.isfinite(full):
            limit = (
                f"the contact closes over the whole period: a half-plane cannot be pressed by {full:.4g} m or more by "
                "this profile; reduce the displacement, give the layer's thickness, or more elements if the contact is "
                "meant to be nearly full"
            )
        deepest = min(full, self.thickness)
        if (beyond := np.flatnonzero(displacement >= deepest)).size:
            reason = limit if deepest == full else f"more than the layer's thickness of {self.thickness:.4g} m"
            raise InputError(f"displacement[{beyond[0]}] is {displacement[beyond[0]]:.4g} m: {reason}")
        return limit

    def _dataset(self, time: Floats, rows: dict[str, Floats], counts: dict[str, int], solver: str) -> xr.Dataset:
        """Dataset of the rows (time,) or (time, element), per unit of depth."""
        variables: dict[str, Any] = {}
        for name, values in rows.items():
            units, text = _VARIABLES[name]
            dims = ("time", "x") if values.ndim == 2 else ("time",)
            scaled = values * self.depth if name == "force" or units == "J" else values
            variables[name] = variable(dims, scaled, units, text)
        coordinates = {"time": variable("time", time, "s", "Time")}
        if any(values.ndim == 2 for values in rows.values()):
            coordinates["x"] = variable("x", self.kernel.position, "m", "Position along the period")
        work = counts | {"elements": self.kernel.elements, "terms": self.creep.n_terms}
        attributes = {"solver": solver, "datum": self.kernel.datum, "profile": self.profile, "work": json.dumps(work)}
        return xr.Dataset(variables, coordinates, attributes)
