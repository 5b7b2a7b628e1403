"""One contact by collocation, from touch to lift-off: the dents on the surface, its outcome, and its course."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from labpipe.arrays import Floats
from labpipe.contact._memory import Creep
from labpipe.contact.impact._radau import MEANS, TO_POWERS, WEIGHTS, interpolation
from labpipe.contact.impact._records import MOTION, N_NODES, STAGES, Fall, Motion, Room, Tables, Trail
from labpipe.contact.impact._ting import LIFTED, contact, peaks_of

# Records of each step: its start and so many instants inside.
_RECORDS_PER_STEP = 12
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(40)


class _Dent(NamedTuple):
    """Displacement (element, node) [m] of springs out to an edge [m], and energy (element,) [J] of the uncovered."""

    edge: float
    values: Floats
    shown: Floats

    def at(self, position: Floats) -> Floats:
        """Displacements (element, spring) at distances from the axis (spring,) [m] within the edge."""
        place = np.sqrt(np.maximum(1.0 - (position / self.edge) ** 2, 0.0))
        return np.asarray(self.values @ interpolation(place).T)


@dataclass(slots=True)
class Dents:
    """Dents that contacts left on the surface: the latest, and the parts of earlier ones that reach beyond it."""

    creep: Creep
    has_energy: bool = True
    layers: list[_Dent] = field(default_factory=list)

    def add(self, edge: float, values: Floats) -> None:
        """Put the dent of a contact over those before it."""
        self.cover(edge)
        shown = np.zeros(self.creep.rate.size)
        if self.has_energy:
            shown = 0.5 * self.creep.inverse * (values**2 @ (edge * MEANS[0]))
        self.layers.append(_Dent(edge, values, shown))

    def cover(self, edge: float) -> None:
        """Take away the parts within an edge [m]."""
        while self.layers and self.layers[-1].edge <= edge:
            self.layers.pop()
        if self.layers and self.has_energy:
            layer = self.layers[-1]
            # The dent ends like a power 3/2 at its edge: smooth over the root of the distance.
            root, width = 0.5 * (_POINTS + 1.0), layer.edge - edge
            shown = self.creep.inverse * (layer.at(layer.edge - width * root**2) ** 2 @ (_WEIGHTS * width * root))
            self.layers[-1] = layer._replace(shown=shown)

    def relax(self, dt: float) -> None:
        """Let all recover for a time [s]."""
        left = np.exp(-dt * self.creep.rate)
        self.layers = [_Dent(edge, left[:, None] * values, left**2 * shown) for edge, values, shown in self.layers]

    @property
    def centre(self) -> Floats:
        """Displacements (element,) of the central spring."""
        return self.layers[-1].values[:, -1].copy() if self.layers else np.zeros(self.creep.rate.size)

    def at(self, position: Floats) -> Floats:
        """Displacements (element, spring) at distances from the axis (spring,) [m]."""
        found = np.zeros((self.creep.rate.size, position.size))
        for layer in self.layers:  # later ones are smaller and lie on top
            inside = position <= layer.edge
            found[:, inside] = layer.at(position[inside])
        return found

    def stored(self) -> Floats:
        """Energy (element,) in J of the free springs."""
        return np.asarray(sum((layer.shown for layer in self.layers), np.zeros(self.creep.rate.size)))


class Bounce(NamedTuple):
    """One contact that ended in a lift-off: largest values, states (end, 8) as in a Room, and records in between."""

    largest: float
    peak_force: float
    peak_approach: float
    deepest: float
    ends: Floats
    course: Trail | None


def bounce(
    tables: Tables, fall: Fall, now: Motion, dents: Dents, counts: dict[str, int], times: Floats | None
) -> Bounce | None:
    """Follow one contact from touch; None unless it shrinks once and ends in a lift-off.

    The dents are those at lift-off then, and ``now`` is that instant. The course is at those of the ``times`` (time,)
    [s] that lie in it, or at instants of its own, and at its end.
    """
    room, centre, outer = tables.room, dents.centre, 0.0
    room.center[: centre.size], room.dent[: centre.size] = centre, 0.0
    if dents.layers:
        outer = dents.layers[-1].edge
        room.dent[: centre.size] = dents.layers[-1].values - centre[:, None]
    state, time = room.state, room.time
    touched, work = now.time, now.spring_work
    origin = now.position - now.plate_displacement - float(centre.sum())
    plate = now.plate_displacement, now.plate_velocity, now.plate_loss
    state[0] = now.position - origin, now.velocity, 0.0, 0.0, *plate, work
    room.approach[0] = 0.0
    outcome, n, peak, rejected = contact(tables.law, fall, outer, room, dents.has_energy)
    counts["rejected_steps"] += rejected
    if outcome != LIFTED:
        return None
    counts["solver_steps"] += n
    counts["kernel_products"] += n
    counts["spring_updates"] += n * centre.size * N_NODES
    largest, lasted = float(state[peak, 3]), float(time[n])
    before = dents.stored()
    dents.cover(largest)
    outside = dents.stored()
    dents.relax(lasted)
    dents.add(largest, room.after[: centre.size].copy())
    done, dissipated, course = state[: n + 1, 7] - work, np.zeros(n + 1), None
    if dents.has_energy:
        stored = room.stored[: n + 1] + np.exp(-2.0 * time[: n + 1, None] * tables.creep.rate) @ outside
        stored[0], stored[n] = before.sum(), dents.stored().sum()
        # A spring that comes or goes between two nodes leaves an error of about 1e-5 between touch and lift-off.
        lost = done - (stored - stored[0])
        dissipated = np.maximum.accumulate(np.clip(lost, 0.0, max(float(lost[-1]), 0.0)))
        part = np.linspace(0.0, 1.0, _RECORDS_PER_STEP + 1)[:-1]
        at = touched + (time[:n, None] + np.diff(time[: n + 1])[:, None] * part).ravel()
        if times is not None:
            at = times[(times >= touched) & (times < touched + lasted)]
        at = np.append(at, touched + lasted)
        course = _course(room, fall, n, peak, np.minimum(at - touched, lasted))
        lost = PchipInterpolator(time[: n + 1], dissipated)(course["time"])
        course["stored"] = stored[0] + course["spring_work"] - work - lost
        course["time"] = at
        for name in ("position", "approach", "surface"):
            course[name] += origin
    peaks, ends = np.zeros(3), state[: n + 1].copy()
    peaks_of(room, n, peaks)
    ends[:, 0] += origin
    end = ends[-1].tolist()
    now.time, now.position, now.velocity = touched + lasted, end[0], end[1]
    now.acceleration, now.force, now.contact_radius = fall.gravity, 0.0, 0.0
    now.plate_displacement, now.plate_velocity, now.plate_loss = end[4], end[5], end[6]
    now.spring_work, now.stored = end[7], float(before.sum()) + done[n] - dissipated[n]
    now.approach = now.position - now.plate_displacement
    if fall.plate_mass:
        now.plate_acceleration = -(fall.plate_damping * end[5] + fall.plate_stiffness * end[4]) / fall.plate_mass
    force, approach, deepest = peaks.tolist()
    return Bounce(largest, force, approach + origin, deepest + origin, ends, course)


def _course(room: Room, fall: Fall, n: int, peak: int, times: Floats) -> Trail:
    """Return records at times (time,) [s] since touch, by the polynomials through the stages of the steps."""
    starts, stages, length = room.state[:n], room.stages[:n], np.diff(room.time[: n + 1])
    power = stages[:, :, 2] * (stages[:, :, 1] - stages[:, :, 5])
    gained = np.stack([power, fall.plate_damping * stages[:, :, 5] ** 2], axis=2)
    gained = length[:, None, None] * np.einsum("il,nlc->nic", WEIGHTS, gained)
    coefficients = np.zeros((n, 8, STAGES + 1))
    coefficients[:, :6, 0] = starts[:, :6]
    values = np.concatenate([stages[:, :, :6], gained], axis=2) - coefficients[:, None, :, 0]
    coefficients[:, :, 1:] = np.einsum("pm,nmc->ncp", TO_POWERS, values)
    coefficients[:, 6, 0], coefficients[:, 7, 0] = starts[:, 7], starts[:, 6]
    # The edge is the square of its radius until the contact is largest, and the place s afterwards.
    receded = np.cumsum(room.edge_powers[peak:n].sum(axis=1))[:-1]
    coefficients[:, 3, 0] = np.concatenate([starts[:peak, 3] ** 2, [0.0], receded])
    coefficients[:, 3, 1:] = room.edge_powers[:n]
    step = np.clip(np.searchsorted(room.time[: n + 1], times, side="right") - 1, 0, n - 1)
    u, values = (times - room.time[step]) / length[step], np.zeros((times.size, 8))
    for p in range(STAGES, -1, -1):
        values = values * u[:, None] + coefficients[step, :, p]
    largest = float(room.state[peak, 3])
    square = np.where(step < peak, values[:, 3], largest**2 * (1.0 - np.minimum(values[:, 3], 1.0) ** 2))
    trail = np.zeros(times.size, MOTION)
    trail["time"], trail["position"], trail["velocity"] = times, values[:, 0], values[:, 1]
    trail["force"] = np.maximum(values[:, 2], 0.0)
    trail["acceleration"] = fall.gravity - trail["force"] / fall.mass
    trail["contact_radius"] = np.sqrt(np.maximum(square, 0.0))
    trail["approach"] = trail["surface"] = trail["position"] - values[:, 4]
    trail["plate_displacement"], trail["plate_velocity"] = values[:, 4], values[:, 5]
    if fall.plate_mass:
        pull = trail["force"] - fall.plate_damping * values[:, 5] - fall.plate_stiffness * values[:, 4]
        trail["plate_acceleration"] = pull / fall.plate_mass
    trail["spring_work"], trail["plate_loss"] = values[:, 6], values[:, 7]
    return trail
