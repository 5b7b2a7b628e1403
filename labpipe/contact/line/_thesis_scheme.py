r"""The thesis's own scheme for the periodic line: full history, J(0) step, dense active set.

Equations (2.13)-(2.16): with uniform steps Δt the pressure σ of step n solves

.. math::
    u_c = J(0)\,G\,\sigma^n, \qquad
    u_c = u - G \sum_{k<n} J((n-k)\Delta t)\,\Delta\sigma^k + J(0)\,G\,\sigma^{n-1},

on a contact set that is found by excluding elements that pull and including elements that
penetrate. The whole history is summed again at each step, so the cost grows with the square of the
number of steps, and a process that is much faster than Δt answers with its instantaneous stiffness
although it has long relaxed: first order in Δt with a large constant.

The reference that the benchmark measures against; nothing else uses it.
"""

import json

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from labpipe.arrays import Flags, Floats
from labpipe.contact.line._kernels import LineKernel, line_kernel
from labpipe.contact.line._profiles import tip_height
from labpipe.contact.memory import checked_history
from labpipe.errors import InputError
from labpipe.materials import Prony
from labpipe.variables import described, variable

_MAX_ITERATIONS = 200
# Steps may differ by rounding of the time column only.
_UNIFORM = 1e-6
_MAX_HISTORY_BYTES = 1 << 30


def indent_thesis_scheme(
    material: Prony,
    tip_radius: float,
    period: float,
    depth: float,
    time: ArrayLike,
    displacement: ArrayLike,
    profile: str = "cosine",
    thickness: float = np.inf,
    elements: int = 256,
) -> xr.Dataset:
    """Run the thesis's scheme; the parameters are those of :func:`labpipe.contact.indent`.

    ``time`` (time,) [s]: Uniform. Returns: ``force`` [N] and ``contact_half_width`` [m] over ``time``; attribute
    ``work`` with ``history_products`` (past increments summed) and ``active_set_solves``. Raises InputError: Time is
    not uniform, the stored history would not fit, or the active set does not settle.

    Examples
    --------
    >>> rubber = Prony(7.6e6, [], [], nu=0.5)
    >>> found = indent_thesis_scheme(rubber, 2e-3, 8e-3, 18e-3, [0.0, 1.0], [0.0, 1e-4])
    >>> round(float(found.force[1]), 1)
    12.4
    """
    times, values = checked_history(time, displacement, "displacement")
    step = _uniform_step(times)
    if times.size * elements * 8 > _MAX_HISTORY_BYTES:
        raise InputError(f"the history of {times.size} steps would take more than 1 GiB")
    kernel = line_kernel(period, elements, thickness, material.nu)
    x = kernel.spacing * np.arange(-(elements // 2), elements - elements // 2, dtype=float)
    height = tip_height(profile, x, tip_radius, period)
    creep = material.creep(step * np.arange(times.size)) * (1.0 - material.nu**2)
    increments = np.zeros((times.size, elements))
    pressure = np.zeros(elements)
    force, width = np.zeros(times.size), np.zeros(times.size)
    solves = products = 0
    for n in range(times.size):
        # J((n−k)Δt) falls on increment k = 0 … n−1.
        memory = creep[n:0:-1] @ increments[:n]
        products += n
        past = kernel.displacement(memory - creep[0] * pressure)
        new, iterations = _active_set(kernel, creep[0], values[n] - height - past, pressure > 0.0)
        solves += iterations
        increments[n] = new - pressure
        pressure = new
        force[n] = depth * kernel.spacing * pressure.sum()
        width[n] = 0.5 * kernel.spacing * np.count_nonzero(pressure)
    work = {"history_products": products, "active_set_solves": solves, "elements": elements}
    labels = described("N", "Normal force")
    edges = described("m", "Half of the contact length of one period")
    return xr.Dataset(
        {"force": ("time", force, labels), "contact_half_width": ("time", width, edges)},
        {"time": variable("time", times, "s", "Time")},
        {"work": json.dumps(work), "datum": kernel.datum},
    )


def _uniform_step(time: Floats) -> float:
    if time.size < 2:
        return 0.0
    steps = np.diff(time)
    step = float(steps.mean())
    if not np.all(np.abs(steps - step) <= _UNIFORM * step) or step <= 0.0:
        raise InputError("the thesis's scheme needs uniform time steps; resample the history")
    return step


def _active_set(kernel: LineKernel, compliance: float, displacement: Floats, start: Flags) -> tuple[Floats, int]:
    """Pressure (element,) with J(0) G p = displacement in contact; and the number of solves."""
    contact = start if np.any(start) else displacement > 0.0
    pressure = np.zeros(displacement.size)
    for count in range(_MAX_ITERATIONS):
        index = np.flatnonzero(contact)
        pressure[:] = 0.0
        if index.size:
            matrix = compliance * kernel.influence[np.abs(index[:, None] - index)]
            pressure[index] = np.linalg.solve(matrix, displacement[index])
        gap = compliance * kernel.displacement(pressure) - displacement
        pulls = contact & (pressure < 0.0)
        penetrates = ~contact & (gap < 0.0)
        if not np.any(pulls) and not np.any(penetrates):
            return pressure, count + 1
        contact = (contact & ~pulls) | penetrates
    raise InputError(f"the active set did not settle in {_MAX_ITERATIONS} iterations")
