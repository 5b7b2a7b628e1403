"""One contact by collocation, from touch to lift-off: its outcome, and its course as polynomials."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from labpipe.arrays import Floats
from labpipe.contact.impact._dents import Dents
from labpipe.contact.impact._method import distinct, law_of, radial_nodes, scheme, work_space
from labpipe.contact.impact._motion import MOTION, Counts, Motion, Trail
from labpipe.contact.impact._records import Fall, Law, Nodes, Path, Room
from labpipe.contact.impact._ting import LIFTED, contact, outcome_of
from labpipe.contact.memory import Condensed, Creep, condense

# Records of each step: its ends and so many instants inside.
_RECORDS_PER_STEP = 12
# Terms may be folded away or frozen where that costs this part of rtol.
_CONDENSE_SHARE = 0.01


class Arrays(NamedTuple):
    """Fields of the path and the nodes as plain arrays: quick to reach from Python."""

    time: Floats
    state: Floats
    approach: Floats
    stored: Floats
    after: Floats


class Tables(NamedTuple):
    """All drops of one material share these: its condensed compliance, its law, and room to compute in."""

    condensed: Condensed
    law: Law
    path: Path
    room: Room
    nodes: Nodes
    arrays: Arrays

    @classmethod
    def of(cls, creep: Creep, shortest: float, longest: float, rtol: float, *, fold: bool) -> "Tables":
        """Leave out terms that no contact of a duration ``shortest`` [s] needs within ``longest`` [s]."""
        condensed = Condensed(creep, 0, 0)
        if fold:
            condensed = condense(creep, shortest, longest, _CONDENSE_SHARE * rtol)
        condensed = Condensed(distinct(condensed.creep), condensed.n_folded, condensed.n_frozen)
        law = law_of(condensed.creep)
        path, room, nodes = work_space(law)
        arrays = Arrays(path.time, path.state, path.approach, path.stored, nodes.after)
        return cls(condensed, law, path, room, nodes, arrays)

    @property
    def creep(self) -> Creep:
        """Compliance with the terms that are left."""
        return self.condensed.creep


class Bounce(NamedTuple):
    """One contact that ended in a lift-off: its place in the path, and its largest values.

    ``touched`` [s], ``origin`` [m]: time and level from which the path counts; ``n``, ``peak``: steps, and those until
    the contact was largest; ``stored``, ``work`` [J]: at touch; ``dissipated`` (step + 1,) [J]; ``mislaid`` [J]: energy
    error at its end, ``worst`` on the way.
    """

    touched: float
    origin: float
    n: int
    peak: int
    largest: float
    stored: float
    work: float
    dissipated: Floats
    peak_force: float
    peak_approach: float
    plate_displacement: float
    deepest: float
    mislaid: float
    worst: float


def bounce(tables: Tables, fall: Fall, now: Motion, dents: Dents, mislaid: float, counts: Counts) -> Bounce | None:
    """Follow one contact from touch; None unless it shrinks once and ends in a lift-off.

    The dents are those at lift-off then, and ``now`` is that instant. ``mislaid`` [J] is the energy error so far.
    """
    path = tables.arrays
    centre = dents.centre
    outer, dent = 0.0, np.zeros((centre.size, radial_nodes().s.size))
    if dents.layers:
        outer, dent, _ = dents.layers[-1]
        dent = dent - centre[:, None]
    touched, work = now.time, now.spring_work
    origin = now.position - now.plate_displacement - float(centre.sum())
    plate = now.plate_displacement, now.plate_velocity, now.plate_loss
    path.state[0] = now.position - origin, now.velocity, 0.0, 0.0, *plate, work
    path.approach[0] = 0.0
    outcome, n, peak, rejected = contact(
        tables.law, scheme(), fall, centre, dent, outer, tables.path, tables.room, tables.nodes, dents.has_energy
    )
    counts.rejected_steps += rejected
    if outcome != LIFTED:
        return None
    counts.solver_steps += n
    counts.kernel_products += n
    counts.spring_updates += n * dent.size
    largest, lasted = float(path.state[peak, 3]), float(path.time[n])
    before = dents.stored()
    dents.cover(largest)
    outside = dents.stored()
    dents.relax(lasted)
    dents.add(largest, path.after[: centre.size].copy())
    done, dissipated = path.state[: n + 1, 7] - work, np.zeros(n + 1)
    if dents.has_energy:
        stored = path.stored[: n + 1] + np.exp(-2.0 * path.time[: n + 1, None] * tables.creep.rate) @ outside
        stored[0], stored[n] = before.sum(), dents.stored().sum()
        dissipated = _monotone(done - (stored - stored[0]), peak)
    peaks = np.zeros(5)
    worst = outcome_of(scheme(), fall, tables.path, n, tables.room, mislaid, peaks)
    end = path.state[n].tolist()
    now.time, now.position, now.velocity = touched + lasted, end[0] + origin, end[1]
    now.acceleration, now.force, now.contact_radius = fall.gravity, 0.0, 0.0
    now.plate_displacement, now.plate_velocity, now.plate_loss = end[4], end[5], end[6]
    now.spring_work, now.stored = end[7], float(before.sum()) + done[n] - dissipated[n]
    now.approach = now.position - now.plate_displacement
    if fall.plate_mass:
        now.plate_acceleration = -(fall.plate_damping * end[5] + fall.plate_stiffness * end[4]) / fall.plate_mass
    highest = (float(peaks[0]), float(peaks[1]) + origin, float(peaks[2]), float(peaks[3]) + origin)
    stored_before = float(before.sum())
    return Bounce(
        touched, origin, n, peak, largest, stored_before, work, dissipated, *highest, float(peaks[4]), float(worst)
    )


def _monotone(lost: Floats, peak: int) -> Floats:
    """Let what is dissipated (step + 1,) grow between its exact values at touch, peak and lift-off.

    Between these a spring that comes or goes between two nodes leaves an error of about 1e-5.
    """
    peak_loss = max(float(lost[peak]), 0.0)
    whole = max(float(lost[-1]), peak_loss)
    result = np.maximum.accumulate(np.maximum(lost, 0.0))
    result[: peak + 1] = np.minimum(result[: peak + 1], peak_loss)
    result[peak:] = np.clip(result[peak:], peak_loss, whole)
    result[-1] = whole
    return result


@dataclass(frozen=True, slots=True)
class Curves:
    """The course of a bounce as polynomials, step by step.

    ``time`` (step + 1,) [s]; ``coefficients`` (step, 8, power) over u from 0 to 1: position, velocity, force, edge,
    displacement and velocity of the plate, work on the springs, loss of the plate; the edge is the square of its radius
    until the contact is largest, and the place s afterwards.
    """

    time: Floats
    coefficients: Floats
    bounce: Bounce
    fall: Fall

    @classmethod
    def of(cls, tables: Tables, fall: Fall, one: Bounce) -> "Curves":
        """Polynomials through the stages of the steps of the path, which the next bounce overwrites."""
        method, path, n, peak = scheme(), tables.path, one.n, one.peak
        starts, stages = path.state[:n], path.stages[:n]
        length = np.diff(path.time[: n + 1])
        power = stages[:, :, 2] * (stages[:, :, 1] - stages[:, :, 5])
        gained = np.stack([power, fall.plate_damping * stages[:, :, 5] ** 2], axis=2)
        gained = length[:, None, None] * np.einsum("il,nlc->nic", method.a, gained)
        values = np.concatenate([stages[:, :, :6], gained], axis=2)
        first = np.concatenate([starts[:, :6], np.zeros((n, 2))], axis=1)
        coefficients = np.empty((n, 8, method.c.size + 1))
        coefficients[:, :, 0] = first
        coefficients[:, :, 1:] = np.einsum("pm,nmc->ncp", method.to_powers, values - first[:, None])
        receded = np.cumsum(path.edge[peak:n].sum(axis=1))[:-1]
        coefficients[:, 3, 0] = np.concatenate([starts[:peak, 3] ** 2, [0.0], receded])
        coefficients[:, 3, 1:] = path.edge[:n]
        coefficients[:, 0, 0] += one.origin
        coefficients[:, 6, 0], coefficients[:, 7, 0] = starts[:, 7], starts[:, 6]
        return cls(one.touched + path.time[: n + 1], coefficients, one, fall)

    def at(self, times: Floats) -> Trail:
        """Return records (time,) at given times [s] within the contact."""
        step = np.clip(np.searchsorted(self.time, times, side="right") - 1, 0, self.time.size - 2)
        u = (times - self.time[step]) / np.diff(self.time)[step]
        values = np.zeros((times.size, self.coefficients.shape[1]))
        for power in range(self.coefficients.shape[2] - 1, -1, -1):
            values = values * u[:, None] + self.coefficients[step, :, power]
        one, fall = self.bounce, self.fall
        receding = one.largest**2 * (1.0 - np.minimum(values[:, 3], 1.0) ** 2)
        square = np.where(step < one.peak, values[:, 3], receding)
        trail = np.zeros(times.size, MOTION)
        trail["time"], trail["position"], trail["velocity"] = times, values[:, 0], values[:, 1]
        trail["force"] = np.maximum(values[:, 2], 0.0)
        trail["acceleration"] = fall.gravity - trail["force"] / fall.mass
        trail["contact_radius"] = np.sqrt(np.maximum(square, 0.0))
        trail["approach"] = values[:, 0] - values[:, 4]
        trail["plate_displacement"], trail["plate_velocity"] = values[:, 4], values[:, 5]
        if fall.plate_mass:
            pull = trail["force"] - fall.plate_damping * values[:, 5] - fall.plate_stiffness * values[:, 4]
            trail["plate_acceleration"] = pull / fall.plate_mass
        trail["spring_work"], trail["plate_loss"] = values[:, 6], values[:, 7]
        lost = PchipInterpolator(self.time, one.dissipated)(times)
        trail["stored"] = one.stored + values[:, 6] - one.work - lost
        return trail

    def natural(self, until: float) -> Trail:
        """Return records at the ends of all steps and at instants between, up to a time [s]."""
        part = np.linspace(0.0, 1.0, _RECORDS_PER_STEP + 1)[:-1]
        times = (self.time[:-1, None] + np.diff(self.time)[:, None] * part).ravel()
        end = min(float(self.time[-1]), until)
        return self.at(np.append(times[times < end], end))
