"""One contact of a sphere, step by step in numpy: the oracle of the compiled steps.

The same rule of motion (average acceleration), memory (:mod:`labpipe.contact.memory`) and control
of the step length as :mod:`labpipe.contact.impact._stepper`, written without any of its code: one
step length at a time, the approach by bisection. No limits, no growth of the contact.
"""

from math import floor, log2

import numpy as np
from scipy.optimize import brentq

from labpipe.contact.memory._creep import advance, history, step_weights

PER_OCTAVE, FIRST, LONGEST = 4, 1e-4, 0.05


def stored_energy(creep, memory, load):
    """Energy (spring,) held elastically: ``(J(0) q^2 + sum w_k^2 / C_k) / 2``."""
    return 0.5 * (creep.instantaneous * load**2 + creep.inverse @ memory**2)


def edge_between(springs, approach, reach, last):
    """Where the load, linear in x^2 between two springs, is zero."""
    inner, outer = springs.position[last : last + 2] ** 2
    share = (approach - reach[last]) / (reach[last + 1] - reach[last])
    return np.sqrt(inner + share * (outer - inner))


def scaled_force(springs, approach, reach):
    """Force times the step compliance: loads linear in x^2 inside a cell, or constant on rings."""
    load = np.maximum(approach - reach, 0.0)
    last = np.count_nonzero(load) - 1
    if last < 0:
        return 0.0
    if not np.isnan(springs.edge_bias):
        return load @ springs.weight
    x = springs.position[last]
    edge = edge_between(springs, approach, reach, last)
    # int (a^2 - s^2)/(a^2 - x^2) ds from x to the edge a, on both sides of the axis
    cut = 2.0 * (edge**2 * (edge - x) - (edge**3 - x**3) / 3.0) / (edge**2 - x**2)
    return load[:last] @ springs.weight[:last] + load[last] * (springs.last_weight[last] + cut)


class NumpyContact:
    """Motion of a sphere on a rigid flat or a plate during one contact."""

    def __init__(self, creep, springs, body, tolerance, time_scale, speed, memory=None):
        self.creep, self.springs, self.body, self.scale = creep, springs, body, time_scale
        self.allowed = tolerance * speed
        self.memory = creep.rest(springs.position.size) if memory is None else memory.copy()
        self.load = np.zeros(springs.position.size)
        # It begins where the sphere meets the dent that is left, at the innermost spring.
        self.z = springs.gap[0] + self.memory[:, 0].sum()
        self.v, self.a, self.time = speed, body.gravity, 0.0
        self.u, self.w, self.b = 0.0, 0.0, 0.0  # plate: displacement, velocity, acceleration
        self.force, self.before = 0.0, (body.gravity, 0.0)
        self.records = []

    def free(self, dt):
        """Sphere and plate after a step without force, and what one newton adds to each."""
        quarter = 0.25 * dt * dt
        z = self.z + dt * self.v + quarter * (self.a + self.body.gravity)
        if self.body.plate is None:
            return z, quarter / self.body.mass, 0.0, 0.0
        plate = self.body.plate
        # (m + c dt/2 + k dt^2/4) a_new = F - c (w + dt a/2) - k (u + dt w + dt^2 a/4)
        inertia = plate.mass + 0.5 * plate.damping * dt + plate.stiffness * quarter
        half_way = self.w + 0.5 * dt * self.b
        reached = self.u + dt * self.w + quarter * self.b
        b = -(plate.damping * half_way + plate.stiffness * reached) / inertia
        return z, quarter / self.body.mass, reached + quarter * b, quarter / inertia

    def attempt(self, dt):
        """Force, approach and unloaded approach of each spring after a step."""
        weights = step_weights(self.creep, dt)
        reach = self.springs.gap + history(weights, self.memory, self.load)
        z, answer, u, plate_answer = self.free(dt)
        target, total = z - u, answer + plate_answer

        def excess(approach):
            push = scaled_force(self.springs, approach, reach) / weights.compliance
            return approach - target + total * push

        approach = target
        if target > reach[0]:
            approach = brentq(excess, reach[0], target, xtol=1e-300, rtol=1e-15)
        return weights, reach, approach, (target - approach) / total

    def lift_off(self, longest):
        def clearance(dt):
            if dt == 0.0:
                return self.creep.instantaneous * self.load[0]
            weights = step_weights(self.creep, dt)
            z, _, u, _ = self.free(dt)
            past = history(weights, self.memory[:, :1], self.load[:1])[0]
            return z - u - self.springs.gap[0] - past

        return brentq(clearance, 0.0, longest, xtol=1e-15 * self.scale, rtol=1e-14)

    def run(self):
        """Step to lift-off; the records are (time, position, velocity, force, stored)."""
        dt, longest = FIRST * self.scale, LONGEST * self.scale
        if self.body.plate is not None:
            longest = min(longest, 1.0 / (40.0 * self.body.plate.frequency))
        while True:
            octave = floor(PER_OCTAVE * log2(min(dt, longest) / self.scale)) / PER_OCTAVE
            step = self.scale * 2.0**octave
            found = self.attempt(step)
            lifted = found[3] <= 0.0 and self.load[0] > 0.0
            if lifted:
                step = self.lift_off(step)
                weights, reach, _, _ = self.attempt(step)
                z, _, u, _ = self.free(step)
                found = weights, reach, min(z - u, reach[0]), 0.0
            error = self.error(step, found[3])
            if error > 1.0:
                dt = step * max(0.3, 0.9 * error ** (-1 / 3))
                continue
            self.accept(step, *found)
            dt = step * min(2.0, 0.9 * max(error, 1e-30) ** (-1 / 3))
            if lifted:
                return np.array(self.records)

    def error(self, dt, force):
        slope = (self.body.gravity - force / self.body.mass - self.a) / dt
        earlier = (self.a - self.before[0]) / self.before[1] if self.before[1] else 0.0
        curvature = abs(slope - earlier) * 2.0 / (dt + self.before[1])
        return dt**3 * curvature / (12.0 * self.allowed)

    def accept(self, dt, weights, reach, approach, force):
        load = np.maximum(approach - reach, 0.0) / weights.compliance
        self.memory = advance(weights, self.memory, self.load, load)
        z, answer, u, plate_answer = self.free(dt)
        moved = u + plate_answer * force
        acceleration = self.body.gravity - force / self.body.mass
        self.before = (self.a, dt)
        self.v += 0.5 * dt * (self.a + acceleration)
        self.z, self.a, self.load = z - answer * force, acceleration, load
        self.time, self.force = self.time + dt, force
        if self.body.plate is not None:
            plate = self.body.plate
            self.w = 2.0 * (moved - self.u) / dt - self.w
            self.u = moved
            self.b = (force - plate.damping * self.w - plate.stiffness * self.u) / plate.mass
        stored = stored_energy(self.creep, self.memory, load) @ self.springs.weight
        self.records.append((self.time, self.z, self.v, force, stored))
