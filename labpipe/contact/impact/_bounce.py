"""The first contact on rigid ground by collocation: its largest values, its course, and the dent that it leaves."""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from labpipe.arrays import Floats
from labpipe.contact._memory import Creep
from labpipe.contact.impact._method import MEANS, N_NODES, STAGES, TO_POWERS, WEIGHTS, Tables, interpolation
from labpipe.contact.impact._records import MOTION, Counts, Fall, Motion, Room, Trail
from labpipe.contact.impact._ting import LIFTED, contact, outcome_of
from labpipe.contact.impact._trajectory import Course

# Records of each step: its start and so many instants inside.
_RECORDS_PER_STEP = 12


class Dent(NamedTuple):
    """Displacement (element, node) [m] of the free springs out to an edge [m]; there are none beyond."""

    creep: Creep
    edge: float
    values: Floats

    def at(self, position: Floats) -> Floats:
        """Displacements (element, spring) at distances from the axis (spring,) [m]."""
        place = np.sqrt(np.maximum(1.0 - (position / self.edge) ** 2, 0.0))
        return np.asarray(self.values @ interpolation(place).T * (position <= self.edge))

    def stored(self) -> Floats:
        """Energy (element,) in J."""
        return np.asarray(0.5 * self.creep.inverse * (self.values**2 @ (self.edge * MEANS[0])))

    def relaxed(self, dt: float) -> "Dent":
        """Return the same after it recovered for a time [s]."""
        return self._replace(values=np.exp(-dt * self.creep.rate)[:, None] * self.values)


def bounce(
    tables: Tables, fall: Fall, now: Motion, counts: Counts, course: Course | None
) -> tuple[Dent, Floats] | None:
    """Follow the contact of a fresh surface from touch; None unless it shrinks once and ends in a lift-off.

    ``now`` is the instant of lift-off then, and the course goes on to there. Returns the dent, and largest position
    [m], force [N] and energy error [J].
    """
    room, creep, touched = tables.room, tables.creep, now.time
    state, time = room.state, room.time
    state[0], state[0, 1] = 0.0, now.velocity
    outcome, n, peak, rejected = contact(tables.law, fall, room, course is not None)
    counts.rejected_steps += rejected
    if outcome != LIFTED:
        return None
    counts.solver_steps += n
    counts.kernel_products += n
    counts.spring_updates += n * creep.rate.size * N_NODES
    lasted = float(time[n])
    dent = Dent(creep, float(state[peak, 3]), room.after[: creep.rate.size].copy())
    peaks = np.zeros(3)
    outcome_of(fall, room, n, peaks)
    left = float(dent.stored().sum())
    if course is not None:
        stored = room.stored[: n + 1].copy()
        stored[0], stored[n] = 0.0, left
        # Dissipation grows between its exact values at touch, peak and lift-off; a spring that comes or goes between
        # two nodes leaves an error of about 1e-5 in the others.
        lost = state[: n + 1, 4] - stored
        lost[n] = max(lost[n], lost[peak], 0.0)
        lost[: peak + 1] = np.clip(lost[: peak + 1], 0.0, max(lost[peak], 0.0))
        lost = np.minimum(np.maximum.accumulate(lost), lost[n])
        part = np.linspace(0.0, 1.0, _RECORDS_PER_STEP + 1)[:-1]
        own = (time[:n, None] + np.diff(time[: n + 1])[:, None] * part).ravel()
        stop = min(lasted, course.end - touched)
        at = course.instants(touched + np.append(own[own < stop], stop), touched + stop)
        trail = _course(room, fall, n, peak, np.minimum(at - touched, lasted))
        trail["stored"] = trail["spring_work"] - PchipInterpolator(time[: n + 1], lost)(trail["time"])
        trail["time"] = at
        course.parts.append(trail)
        left = float(state[n, 4] - lost[n])
    now.position, now.velocity, _, _, now.spring_work = state[n].tolist()
    now.time, now.acceleration, now.approach, now.stored = touched + lasted, fall.gravity, now.position, left
    return dent, peaks


def _course(room: Room, fall: Fall, n: int, peak: int, times: Floats) -> Trail:
    """Return records at times (time,) [s] since touch, by the polynomials through the stages of the steps."""
    starts, stages, length = room.state[:n], room.stages[:n], np.diff(room.time[: n + 1])
    gained = length[:, None] * (stages[:, :, 2] * stages[:, :, 1] @ WEIGHTS.T)
    coefficients = np.zeros((n, 5, STAGES + 1))
    coefficients[:, :4, 0] = starts[:, :4]
    values = np.concatenate([stages, gained[:, :, None]], axis=2) - coefficients[:, None, :, 0]
    coefficients[:, :, 1:] = np.einsum("pm,nmc->ncp", TO_POWERS, values)
    coefficients[:, 4, 0] = starts[:, 4]
    # The edge is the square of its radius until the contact is largest, and the place s afterwards.
    receded = np.cumsum(room.edge_powers[peak:n].sum(axis=1))[:-1]
    coefficients[:, 3, 0] = np.concatenate([starts[:peak, 3] ** 2, [0.0], receded])
    coefficients[:, 3, 1:] = room.edge_powers[:n]
    step = np.clip(np.searchsorted(room.time[: n + 1], times, side="right") - 1, 0, n - 1)
    u, values = (times - room.time[step]) / length[step], np.zeros((times.size, 5))
    for p in range(STAGES, -1, -1):
        values = values * u[:, None] + coefficients[step, :, p]
    largest = float(room.state[peak, 3])
    square = np.where(step < peak, values[:, 3], largest**2 * (1.0 - np.minimum(values[:, 3], 1.0) ** 2))
    trail = np.zeros(times.size, MOTION)
    trail["time"], trail["position"], trail["velocity"] = times, values[:, 0], values[:, 1]
    trail["force"] = np.maximum(values[:, 2], 0.0)
    trail["acceleration"] = fall.gravity - trail["force"] / fall.mass
    trail["contact_radius"] = np.sqrt(np.maximum(square, 0.0))
    trail["approach"] = trail["surface"] = trail["position"]
    trail["spring_work"] = values[:, 4]
    return trail
