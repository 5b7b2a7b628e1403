"""Bounces by collocation: dents between contacts, and each contact as polynomials over time.

:class:`Bouncer` follows the contacts that end in a lift-off; a contact that grows again before it
does, or in which the sphere comes to rest, is left to :class:`._stepper.Stepper`.
"""

from dataclasses import dataclass, field
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from labpipe.arrays import Floats
from labpipe.contact.impact._collocation import interpolation, law_of, scheme, work_space
from labpipe.contact.impact._contact import LIFTED, contact, outcome_of
from labpipe.contact.impact._contact_records import Fall, Law, Nodes, Path, Room
from labpipe.contact.impact._motion import MOTION, Counts, Motion, Trail
from labpipe.contact.memory import Creep

# Records of each step: its ends and so many instants inside.
_RECORDS_PER_STEP = 12
_GAUSS_POINTS = 40
# First and longest step over the duration of the first contact.
FIRST, LONGEST = 1e-6, 0.34
# Tolerance of a step over rtol: restitution errs by less than that, a long train by some ten times.
STEP_SHARE = 0.05


class _Dent(NamedTuple):
    """Displacement (element, node) [m] of the springs out to an edge [m].

    ``shown`` (element,) [J] is the energy of those that no later dent covers.
    """

    edge: float
    values: Floats
    shown: Floats


@dataclass(slots=True)
class Dents:
    """What contacts left on the surface: the latest, and what reaches beyond it of earlier ones."""

    creep: Creep
    layers: list[_Dent] = field(default_factory=list)

    def add(self, edge: float, values: Floats) -> None:
        """Put the dent of a contact over those before it."""
        self.cover(edge)
        share = edge * scheme().means[0]
        self.layers.append(_Dent(edge, values, 0.5 * self.creep.inverse * (values**2 @ share)))

    def cover(self, edge: float) -> None:
        """Take away what lies within an edge [m]."""
        while self.layers and self.layers[-1].edge <= edge:
            self.layers.pop()
        if self.layers:
            self.layers[-1] = self._beyond(self.layers[-1], edge)

    def relax(self, dt: float) -> None:
        """Let all recover for a time [s]."""
        left = np.exp(-dt * self.creep.rate)
        self.layers = [_Dent(edge, left[:, None] * values, left**2 * shown) for edge, values, shown in self.layers]

    @property
    def centre(self) -> Floats:
        """Displacements (element,) of the central spring."""
        if not self.layers:
            return np.zeros(self.creep.rate.size)
        return np.ascontiguousarray(self.layers[-1].values[:, -1])

    def at(self, position: Floats) -> Floats:
        """Displacements (element, spring) at distances from the axis (spring,) [m]."""
        found = np.zeros((self.creep.rate.size, position.size))
        for layer in self.layers:  # later ones are smaller and lie on top
            inside = position <= layer.edge
            found[:, inside] = _values(layer, position[inside])
        return found

    def stored(self) -> Floats:
        """Energy (element,) in J of the free springs."""
        return np.sum([layer.shown for layer in self.layers], axis=0) + np.zeros(self.creep.rate.size)

    def _beyond(self, layer: _Dent, inner: float) -> _Dent:
        """Count the energy of a dent beyond a radius [m] only."""
        points, weights = _gauss_rule()
        # The dent ends like a power 3/2 at its edge: smooth over the root of the distance.
        root, width = 0.5 * (points + 1.0), layer.edge - inner
        values = _values(layer, layer.edge - width * root**2)
        return layer._replace(shown=self.creep.inverse * (values**2 @ (weights * width * root)))


@cache
def _gauss_rule() -> tuple[Floats, Floats]:
    """Points (point,) from -1 to 1, and their weights."""
    return np.polynomial.legendre.leggauss(_GAUSS_POINTS)


def _values(layer: _Dent, position: Floats) -> Floats:
    """Displacements (element, spring) within a dent."""
    place = np.sqrt(np.maximum(1.0 - (position / layer.edge) ** 2, 0.0))
    return np.asarray(layer.values @ interpolation(scheme().s, scheme().bary, place).T)


@dataclass(frozen=True, slots=True)
class Curves:
    """A contact as polynomials, step by step; times from first touch.

    ``time`` (step + 1,) [s]; ``coefficients`` (step, 8, power): over u from 0 to 1: position, velocity, force, edge,
    displacement and velocity of the plate, work on the springs, loss of the plate; ``n_growing``: steps until the
    contact was largest; the edge is the square of its radius till then, and the place s afterwards, of a contact of
    radius ``largest`` [m]; ``dissipated`` (step + 1,) [J]: by the springs, at the ends; ``peak_force``,
    ``peak_approach``, ``penetration`` [N] [m] [m]: the largest, also between the ends; the last of the sphere from
    where it touched.
    """

    time: Floats
    coefficients: Floats
    n_growing: int
    largest: float
    dissipated: Floats
    stored: float
    work: float
    gravity: float
    mass: float
    plate: tuple[float, float, float]
    peak_force: float
    peak_approach: float
    penetration: float

    def at(self, times: Floats) -> Trail:
        """Return records (time,) at given times [s] within the contact."""
        step = np.clip(np.searchsorted(self.time, times, side="right") - 1, 0, self.time.size - 2)
        u = (times - self.time[step]) / np.diff(self.time)[step]
        values = np.zeros((times.size, self.coefficients.shape[1]))
        for power in range(self.coefficients.shape[2] - 1, -1, -1):
            values = values * u[:, None] + self.coefficients[step, :, power]
        growing = step < self.n_growing
        square = np.where(growing, values[:, 3], self.largest**2 * (1.0 - np.minimum(values[:, 3], 1.0) ** 2))
        trail = np.zeros(times.size, MOTION)
        trail["time"], trail["position"], trail["velocity"] = times, values[:, 0], values[:, 1]
        trail["force"] = np.maximum(values[:, 2], 0.0)
        trail["acceleration"] = self.gravity - trail["force"] / self.mass
        trail["contact_radius"] = np.sqrt(np.maximum(square, 0.0))
        trail["approach"] = values[:, 0] - values[:, 4]
        trail["plate_displacement"], trail["plate_velocity"] = values[:, 4], values[:, 5]
        mass, stiffness, damping = self.plate
        if mass > 0.0:
            pull = trail["force"] - damping * values[:, 5] - stiffness * values[:, 4]
            trail["plate_acceleration"] = pull / mass
        trail["spring_work"], trail["plate_loss"] = values[:, 6], values[:, 7]
        lost = PchipInterpolator(self.time, self.dissipated)(times)
        trail["stored"] = self.stored + values[:, 6] - self.work - lost
        return trail

    def natural(self, until: float) -> Trail:
        """Return records at the ends of all steps and at instants between, up to a time [s]."""
        part = np.linspace(0.0, 1.0, _RECORDS_PER_STEP + 1)[:-1]
        times = (self.time[:-1, None] + np.diff(self.time)[:, None] * part).ravel()
        end = min(float(self.time[-1]), until)
        return self.at(np.append(times[times < end], end))


@dataclass(slots=True)
class Bouncer:
    """Contacts of one sphere by collocation, and the dents between them."""

    creep: Creep
    mass: float
    gravity: float
    radius: float
    is_sphere: bool
    plate: tuple[float, float, float]
    duration: float
    rtol: float
    dents: Dents = field(init=False)
    law: Law = field(init=False)
    path: Path = field(init=False)
    room: Room = field(init=False)
    nodes: Nodes = field(init=False)
    largest: Floats = field(init=False, default_factory=lambda: np.zeros(5))

    def __post_init__(self) -> None:
        self.dents = Dents(self.creep)
        self.law = law_of(self.creep)
        self.path, self.room, self.nodes = work_space(self.law)

    def bounce(self, now: Motion, speed: float, counts: Counts) -> Curves | None:
        """Follow one contact from touch; None unless it shrinks once and ends in a lift-off.

        The dents are those at lift-off then, and ``now`` is that instant.
        """
        path, law = self.path, self.law
        centre = self.dents.centre
        outer, dent = 0.0, np.zeros((centre.size, scheme().s.size))
        if self.dents.layers:
            outer, dent, _ = self.dents.layers[-1]
            dent = dent - centre[:, None]
        fall = Fall(
            self.mass,
            self.gravity,
            self.radius,
            self.is_sphere,
            *self.plate,
            STEP_SHARE * self.rtol * speed,
            LONGEST * self.duration,
            FIRST * self.duration,
        )
        touched = now.time
        origin = now.position - now.plate_displacement - float(centre.sum())
        path.state[0] = (
            now.position - origin,
            now.velocity,
            0.0,
            0.0,
            now.plate_displacement,
            now.plate_velocity,
            now.plate_loss,
            now.spring_work,
        )
        path.approach[0] = 0.0
        outcome, n, peak, rejected = contact(
            law, scheme(), fall, centre, dent, outer, 0, path, self.room, self.nodes, True
        )
        counts.rejected_steps += rejected
        if outcome != LIFTED:
            return None
        counts.solver_steps += n
        counts.kernel_products += n
        counts.spring_updates += n * dent.size
        largest = float(path.state[peak, 3])
        before = self.dents.stored()
        self.dents.cover(largest)
        outside = self.dents.stored()
        lasted = float(path.time[n])
        self.dents.relax(lasted)
        self.dents.add(largest, self.nodes.after[: self.creep.rate.size].copy())
        left = self.dents.stored()
        lag = path.time[: n + 1, None]
        stored = path.stored[: n + 1] + np.exp(-2.0 * lag * self.creep.rate) @ outside
        stored[0], stored[n] = before.sum(), left.sum()
        work = path.state[: n + 1, 7] - now.spring_work
        dissipated = _monotone(work - (stored - stored[0]), peak)
        outcome_of(scheme(), fall, path, n, self.room, 0.0, self.largest)
        curves = self._curves(touched, n, peak, origin, dissipated, float(before.sum()), now.spring_work)
        end = path.state[n]
        now.time, now.position, now.velocity = touched + lasted, end[0] + origin, end[1]
        now.acceleration, now.force, now.contact_radius = self.gravity, 0.0, 0.0
        now.plate_displacement, now.plate_velocity, now.plate_loss = end[4], end[5], end[6]
        now.spring_work, now.stored = end[7], float(before.sum()) + work[n] - dissipated[n]
        now.approach = now.position - now.plate_displacement
        mass, stiffness, damping = self.plate
        now.plate_acceleration = -(damping * end[5] + stiffness * end[4]) / mass if mass else 0.0
        return curves

    def _curves(
        self, touched: float, n: int, peak: int, origin: float, dissipated: Floats, stored: float, work: float
    ) -> Curves:
        """Polynomials through the stages of the steps of the path."""
        method, path = scheme(), self.path
        starts, stages = path.state[:n].copy(), path.stages[:n]
        length = np.diff(path.time[: n + 1])
        power = stages[:, :, 2] * (stages[:, :, 1] - stages[:, :, 5])
        drag = self.plate[2] * stages[:, :, 5] ** 2
        gained = np.stack([power, drag], axis=2)
        gained = length[:, None, None] * np.einsum("il,nlc->nic", method.a, gained)
        # Position, velocity, force; the edge has coefficients of its own; plate; work and loss.
        values = np.concatenate([stages[:, :, [0, 1, 2, 3, 4, 5]], gained], axis=2)
        first = np.stack([*starts[:, :6].T, 0.0 * starts[:, 0], 0.0 * starts[:, 0]], axis=1)
        coefficients = np.empty((n, 8, method.c.size + 1))
        coefficients[:, :, 0] = first
        coefficients[:, :, 1:] = np.einsum("pm,nmc->ncp", method.to_powers, values - first[:, None])
        edge = np.zeros(n)
        edge[:peak] = starts[:peak, 3] ** 2
        edge[peak:] = np.concatenate([[0.0], np.cumsum(path.edge[peak:n].sum(axis=1))])[: n - peak]
        coefficients[:, 3, 0], coefficients[:, 3, 1:] = edge, path.edge[:n]
        coefficients[:, 0, 0] += origin
        coefficients[:, 6, 0], coefficients[:, 7, 0] = starts[:, 7], starts[:, 6]
        time = touched + path.time[: n + 1]
        return Curves(
            time,
            coefficients,
            peak,
            float(path.state[peak, 3]),
            dissipated,
            stored,
            work,
            self.gravity,
            self.mass,
            self.plate,
            float(self.largest[0]),
            float(self.largest[1]) + origin,
            float(self.largest[3] - starts[0, 0]),
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
