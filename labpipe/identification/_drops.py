"""Bounces of a sphere as data: touch times, contact durations, largest contact radii.

The simulator is not linear in the material, so derivatives are differences: by the terms of the
relaxation modulus themselves, since a bounce hardly depends on how a modulus is divided among
terms, and by a set part of the modulus of a contact, since a term may be next to nothing. Over the
relaxation time they are a smooth curve, of which far from a contact every second point is enough.
The simulator's answer is smooth also with coarse steps, whose values a fuller run corrects. Two
unknowns cost no run: on a rigid floor the motion depends on modulus, mass and radius by
``E sqrt(R) / m`` alone (gap ``r^2/2R``; contact radii go with ``sqrt(R)`` besides), so their
derivatives are those of a common factor of all moduli (of the sphere's alone, which on a stiff counter-body is the
same to a percent). A plate moves by the ratio of the masses.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import sqrt
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from labpipe import contact
from labpipe.arrays import Floats, Integers
from labpipe.contact.impact import Profile
from labpipe.errors import InputError
from labpipe.identification._evidence import Evidence, Given, Group
from labpipe.materials import Prony

_CHANGE = 0.002  # of all moduli, a height or a mass, for central differences
_BOTH_SIDES = (1.0 + _CHANGE, 1.0 - _CHANGE)
_ONE_SIDED = 5e-4
"""Of the modulus of a contact. A lossy term as large shifts the last touch by some ten of its
deviations; ten times larger steps turned the phase of a ringing plate there by a radian."""
_DENSE = (0.03, 30.0)  # durations of a contact between which the derivative bends most
_FROZEN = 100.0  # a term this many times slower than the record does not relax in it
_VISCOUS = 0.003  # in durations of a contact: quicker terms are dashpots, with derivatives as times
_FAST = 3e-4  # rtol of the fast model: smooth to 1/100 of a deviation of a touch, off by some 1e-5
_MORE_TIME = 4.0  # a run may last longer than the record: a trial may bounce higher
_RESOLVED = 0.1  # of a contact's duration is the shortest time of which it tells
ROLES = ("height", "mass", "radius", "modulus", "trigger", "pulse", "pixel", "plate")
"""What of a drop may be unknown: fall [m], mass [kg] that moves, radius [m] of the sphere, factor of the
modulus of a contact (1 at best), delay [s] of the first contact's reading, shape of the pulse in its
deviations, scale of the film (1 at best), modal mass [kg] of the plate."""
_STIFFNESS = {"mass", "radius", "modulus"}  # whose effect is that of a common factor of all moduli


@dataclass(frozen=True, eq=False)
class DropModel:
    """Predicts the bounces of one drop.

    ``radius``, ``mass``, ``height``, ``gravity`` [m], [kg], [m], [m/s2]: Best values. ``touches``, ``durations``,
    ``radii``: Which impacts, from 0, are observed: times of touch since the first contact (from 1), durations of
    contact, largest contact radii. ``last`` [s]: Time of the last observation since first contact.
    ``expected_duration`` [s]: Of a contact. ``names``: Unknowns of the problem by :data:`ROLES`; the others are
    taken at its best value. ``plate``: On which the sphere falls; a rigid floor by default. ``flat``: Counter-body;
    rigid by default. ``rtol``: Of the
    simulator for the fuller model; the fast one takes coarser steps. ``shared`` (duration,): Change of every
    duration by one deviation of the pulse's shape.
    """

    radius: float
    mass: float
    height: float
    gravity: float
    touches: Integers
    durations: Integers
    radii: Integers
    last: float
    expected_duration: float
    names: Mapping[str, str] = field(default_factory=dict)
    profile: Profile = "parabola"
    plate: contact.Plate | None = None
    flat: contact.CounterBody | None = None
    rtol: float = 1e-4
    shared: Floats | None = None

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return tuple(self.names.values())

    @property
    def window(self) -> tuple[float, float]:
        """A tenth of a contact to a contact [s]: slower terms are stiffness to an impact.

        Beyond, a record of bounces follows the prior, however long it lasts.
        """
        return _RESOLVED * self.expected_duration, self.expected_duration

    def predict(self, material: Prony, given: Given) -> Floats:
        """Return touches [s], durations [s] and radii [m], one behind the other.

        An impact that does not happen any more counts as at the last one, with no contact.
        """
        return self._finished(self._runs([_Trial(material, given)])[0], given)

    def derivatives(self, material: Prony, given: Given) -> tuple[Floats, dict[str, Floats]]:
        """Return differences; see :meth:`Model.derivatives`."""
        # Of the times of the material, those whose derivatives are worth a run. Slower terms are stiffness to a
        # record, quicker ones viscosity; between the nodes the derivative is a smooth curve.
        rho, lasting = material.rho, self.expected_duration
        first = max(int(np.searchsorted(rho, _VISCOUS * lasting, "right")) - 1, 0)
        nodes = rho[first:][rho[first:] <= _FROZEN * self.last]
        relative = nodes / lasting
        is_dense = (relative >= _DENSE[0]) & (relative <= _DENSE[1])
        is_end = np.isin(np.arange(nodes.size), (0, nodes.size - 1))
        nodes = nodes[is_dense | is_end | (np.arange(nodes.size) % 2 == 0)]
        step = _ONE_SIDED * abs(complex(material.complex_modulus(np.array([np.pi / lasting]))[0]))
        moved = ["height", "plate"] if self.plate is None else ["height", "plate", "mass"]
        moved = [self.names[role] for role in moved if role in self.names]
        trials = [
            _Trial(material, given),
            _Trial(Prony(material.E_relaxed + step, material.E, rho, material.nu), given),
        ]
        more = [material.E + step * (rho == time) for time in nodes]
        trials += [_Trial(Prony(material.E_relaxed, terms, rho, material.nu), given) for terms in more]
        scaled = _STIFFNESS & set(self.names)  # by terms it would be a small difference of large ones
        trials += [_Trial(material.scaled(factor), given) for factor in _BOTH_SIDES if scaled]
        for name in moved:
            trials += [_Trial(material, {**given, name: factor * given[name]}) for factor in _BOTH_SIDES]
        made = iter(self._runs(trials))
        at = next(made)
        by_term = np.empty((at.size, rho.size + 1))
        by_term[:] = ((next(made) - at) / step)[:, None]
        columns = [(next(made) - at) / step for _ in nodes]
        if columns:
            is_moving = rho <= _FROZEN * self.last
            inside = np.log(np.clip(rho[is_moving], nodes[0], nodes[-1]))
            several = len(columns) > 1
            curve = PchipInterpolator(np.log(nodes), np.stack(columns))(inside).T if several else columns[0][:, None]
            by_term[:, 1:][:, is_moving] = curve
            by_term[:, 1:] *= np.where(rho < nodes[0], rho / nodes[0], 1.0)

        def central() -> Floats:
            """Return the derivative (n,) by the logarithm of a quantity changed on both sides."""
            return np.asarray((next(made) - next(made)) / (2.0 * _CHANGE))

        is_touch, is_radius, by_pulse = self._kinds
        by_factor = central() if scaled else np.zeros(at.size)
        body = {"modulus": by_factor, "mass": -by_factor, "radius": 0.5 * (by_factor + is_radius * at)}
        others = {
            self.names[role]: column / given[self.names[role]] for role, column in body.items() if role in self.names
        }
        others |= {name: central() / given[name] for name in moved}
        factor = self._film(given)
        finished = {name: factor * column for name, column in others.items()}
        recording = {"trigger": -is_touch, "pulse": by_pulse, "pixel": is_radius * at}
        finished |= {self.names[role]: column for role, column in recording.items() if role in self.names}
        return factor[:, None] * by_term, finished

    def refined(self, material: Prony, given: Given) -> Floats | None:
        """Return the numbers of an accurate run."""
        numbers = self._runs([_Trial(material, given)], is_full=True)[0]
        return self._finished(numbers, given)

    def _finished(self, numbers: Floats, given: Given) -> Floats:
        is_touch, _, by_pulse = self._kinds
        read = self._value("pulse", 0.0, given) * by_pulse - self._value("trigger", 0.0, given) * is_touch
        return np.asarray(self._film(given) * numbers + read)

    def _film(self, given: Given) -> Floats:
        return np.asarray(self._value("pixel", 1.0, given) ** self._kinds[1])

    @cached_property
    def _kinds(self) -> tuple[Floats, Floats, Floats]:
        """One for touches (n,), one for radii, and the change of the numbers by one deviation of the pulse."""
        ends = np.cumsum([self.touches.size, self.durations.size, self.radii.size])
        place = np.arange(ends[2])
        by_pulse = np.zeros(ends[2])
        if self.shared is not None:
            by_pulse[ends[0] : ends[1]] = self.shared
        return (place < ends[0]).astype(float), (place >= ends[1]).astype(float), by_pulse

    def _value(self, role: str, best: float, given: Given) -> float:
        return given[self.names[role]] if role in self.names else best

    def _runs(self, trials: "Sequence[_Trial]", *, is_full: bool = False) -> list[Floats]:
        """Simulate with the best mass and radius and materials that make up for them."""
        needed = 1 + max((int(w.max()) for w in (self.touches, self.durations, self.radii) if w.size), default=0)
        wider, solids, heights, flats = [], [], [], list[contact.CounterBody | None]()
        for material, given in trials:
            mass, radius = self._value("mass", self.mass, given), self._value("radius", self.radius, given)
            wider.append(sqrt(radius / self.radius))
            stiffer = self._value("modulus", 1.0, given)
            makes_up = self.mass / mass * wider[-1]
            solids.append(material.scaled(stiffer * makes_up))
            flats.append(self.flat and self.flat._replace(E=self.flat.E * makes_up))
            heights.append(self._value("height", self.height, given))
        # The plate is as heavy in proportion to the best mass of the sphere.
        plates = [
            self.plate
            and replace(
                self.plate,
                mass=self._value("plate", self.plate.mass, given) * self.mass / self._value("mass", self.mass, given),
            )
            for _, given in trials
        ]
        # Simulations end with the last impact that was observed, or at rest.
        after = _MORE_TIME * (self.last + self.expected_duration)
        made = contact.impacts(
            solids,
            self.radius,
            self.mass,
            heights,
            [sqrt(2.0 * height / self.gravity) + after for height in heights],
            needed,
            self.profile,
            self.rtol if is_full else max(_FAST, self.rtol),
            gravity=self.gravity,
            plate=plates,
            substrate=list(flats),
        )
        names = ("impact_time", "contact_duration", "peak_contact_radius")
        found = np.stack([made[name].values for name in names], axis=1)
        return [self._observed(columns, factor) for columns, factor in zip(found, wider, strict=True)]

    def _observed(self, columns: Floats, wider: float) -> Floats:
        """Return the observed numbers of the impacts, from touch, duration and radius (column, impact)."""
        touch, lasted, radii = columns[:, np.isfinite(columns[0])]
        if not touch.size:
            raise InputError("the sphere does not bounce: there is nothing to predict")
        return np.concatenate(
            [
                touch[np.minimum(self.touches, touch.size - 1)] - touch[0],
                np.where(self.durations < touch.size, _at(lasted, self.durations), 0.0),
                np.where(self.radii < touch.size, _at(radii, self.radii), 0.0) * wider,
            ]
        )


class _Trial(NamedTuple):
    """One simulation: a material, and the values of the unknowns."""

    material: Prony
    given: Given


def _at(values: Floats, index: Integers) -> Floats:
    return np.asarray(values[np.minimum(index, values.size - 1)])


@dataclass(frozen=True, eq=False)
class Bounces:
    """Observed bounces, of a laser record or a film; NaN where one was not seen.

    ``touch``, ``u_touch`` (impact,) [s]: Times since first contact; the first is 0 and its uncertainty that of the
    trigger. ``duration``, ``u_duration`` (impact,) [s]: Of the contacts, without the part of the uncertainty that all
    share. ``radius``, ``u_radius`` (impact,) [m]: Largest contact radii, without the part of the uncertainty that all
    share. ``shared_duration`` (impact,): The part of the durations that all share: the shape of the pulse that was
    fitted.
    """

    touch: Floats
    u_touch: Floats
    duration: Floats
    u_duration: Floats
    radius: Floats
    u_radius: Floats
    shared_duration: Floats | None = None


def drop_evidence(name: str, seen: Bounces, model: DropModel) -> Evidence:
    """Pair observed bounces with the model that predicts them.

    ``name``: Of the experiment. ``seen``: Observations. ``model``: Everything but ``touches``, ``durations``,
    ``radii``, ``last``, ``expected_duration`` and ``shared``, which follow from the observations. Raises InputError:
    Nothing was seen.
    """
    times = _seen(seen.touch, seen.u_touch)
    times = times[times > 0]
    lasted, radii = _seen(seen.duration, seen.u_duration), _seen(seen.radius, seen.u_radius)
    groups = [
        Group(label, values[at], u[at], np.asarray(at + 1, float), units, "impact", "1")
        for label, at, values, u, units in (
            ("time of touch", times, seen.touch, seen.u_touch, "s"),
            ("contact duration", lasted, seen.duration, seen.u_duration, "s"),
            ("largest contact radius", radii, seen.radius, seen.u_radius, "m"),
        )
        if at.size
    ]
    if not groups:
        raise InputError(f"{name}: no bounce with a known uncertainty was observed")
    # half a period of a contact of radius R/10 in a body of 1 GPa, where no contact was timed
    expected = float(np.pi * sqrt(model.mass / (2.0 * 1e9 * 0.1 * model.radius)))
    if lasted.size:
        expected = float(np.median(seen.duration[lasted]))
    fall = sqrt(2.0 * model.height / model.gravity)
    last = float(seen.touch[times].max()) if times.size else fall * max(int(radii.max()), 1)
    shared = None if seen.shared_duration is None else seen.shared_duration[lasted]
    full = replace(
        model, touches=times, durations=lasted, radii=radii, last=last, expected_duration=expected, shared=shared
    )
    return Evidence(name, tuple(groups), full)


def _seen(values: Floats, u: Floats) -> Integers:
    return np.flatnonzero(np.isfinite(values) & np.isfinite(u) & (u > 0.0))
