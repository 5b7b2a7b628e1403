"""Bounces of a sphere as data: touch times, contact durations, largest contact radii.

The simulator is not linear in the material, so derivatives are differences: by the terms of the
relaxation modulus themselves, since a bounce hardly depends on how a modulus is divided among
terms, and by a set part of the modulus of a contact, since a term may be next to nothing. Over the
relaxation time they are a smooth curve, of which far from a contact every second point is enough.
The simulator's answer is smooth also with coarse steps, whose values a fuller run corrects.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import sqrt

import numpy as np
from scipy.interpolate import PchipInterpolator

from labpipe import contact
from labpipe.arrays import Floats, Integers
from labpipe.contact.impact import Profile
from labpipe.errors import InputError
from labpipe.identification._evidence import Evidence, Given, Group
from labpipe.materials import Prony

_CHANGE = 5e-4
"""Of an unknown, and of the modulus of a contact, for differences. A lossy term as large shifts the last touch by some
ten of its deviations; ten times larger steps turned the phase of a ringing plate there by a radian."""
_DENSE = (0.03, 30.0)  # durations of a contact between which the derivative bends most
_FROZEN = 100.0  # a term this many times slower than the record does not relax in it
_VISCOUS = 0.003  # in durations of a contact: quicker terms are dashpots, with derivatives as times
_FAST = 3e-4  # rtol of the fast model: smooth to 1/100 of a deviation of a touch, off by some 1e-5
_MORE_TIME = 4.0  # a run may last longer than the record: a trial may bounce higher
_RESOLVED = 0.1  # of a contact's duration is the shortest time of which it tells
_ADDED = {"trigger", "pulse"}  # to the numbers: zero at best


@dataclass(frozen=True, eq=False)
class DropModel:
    """Predicts the bounces of one drop.

    ``radius``, ``mass``, ``height``, ``gravity`` [m], [kg], [m], [m/s2]: Best values. ``touches``, ``durations``,
    ``radii``: Which impacts, from 0, are observed: times of touch since the first contact (from 1), durations of
    contact, largest contact radii. ``last`` [s]: Time of the last observation since first contact.
    ``expected_duration`` [s]: Of a contact. ``names``: Unknowns of the problem by their role: "height" [m] of the fall,
    "mass" [kg] that moves, "radius" [m] of the sphere, "modulus", a factor of that of the contact (1 at best),
    "trigger" [s], the delay of the first contact's reading, "pulse", its shape in its deviations, "pixel", the scale of
    the film (1 at best), "plate" [kg], its modal mass; the others are taken at their best values. ``plate``: On which
    the sphere falls; a rigid floor by default. ``flat``: Counter-body; rigid by default. ``rtol``: Of the simulator for
    the fuller model; the fast one takes coarser steps. ``shared`` (duration,): Change of every duration by one
    deviation of the pulse's shape.
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

    def predict(self, material: Prony, given: Given, *, is_full: bool = False) -> Floats:
        """Return touches [s], durations [s] and radii [m], one behind the other.

        An impact that does not happen any more counts as at the last one, with no contact.
        """
        return self._runs([(material, given)], self.rtol if is_full else max(_FAST, self.rtol))[0]

    def derivatives(self, material: Prony, given: Given) -> tuple[Floats, dict[str, Floats]]:
        """Return differences; see :meth:`Model.derivatives`."""
        # Of the times of the material, those whose derivatives are worth a run. Slower terms are stiffness to a
        # record, quicker ones viscosity; between the nodes the derivative is a smooth curve.
        rho, lasting = material.rho, self.expected_duration
        is_moving = rho <= _FROZEN * self.last
        nodes = rho[max(int(np.searchsorted(rho, _VISCOUS * lasting, "right")) - 1, 0) : np.count_nonzero(is_moving)]
        is_dense = (nodes >= _DENSE[0] * lasting) & (nodes <= _DENSE[1] * lasting)
        is_end = np.isin(np.arange(nodes.size), (0, nodes.size - 1))
        nodes = nodes[is_dense | is_end | (np.arange(nodes.size) % 2 == 0)]
        step = _CHANGE * abs(complex(material.complex_modulus(np.array([np.pi / lasting]))[0]))
        more = [Prony(material.E_relaxed + step, material.E, rho, material.nu)]
        more += [Prony(material.E_relaxed, material.E + step * (rho == time), rho, material.nu) for time in nodes]
        moved = {name: _CHANGE * (1.0 if role in _ADDED else given[name]) for role, name in self.names.items()}
        sides = [{**given, name: given[name] + far} for name, far in moved.items()]
        trials = [(material, given), *((solid, given) for solid in more), *((material, side) for side in sides)]
        at, *made = self._runs(trials, max(_FAST, self.rtol))
        relaxed, *columns = ((one - at) / step for one in made[: len(more)])
        by_term = np.repeat(relaxed[:, None], rho.size + 1, axis=1)
        if len(columns) > 1:
            inside = np.log(np.clip(rho[is_moving], nodes[0], nodes[-1]))
            by_term[:, 1:][:, is_moving] = PchipInterpolator(np.log(nodes), np.stack(columns))(inside).T
        elif columns:
            by_term[:, 1:][:, is_moving] = columns[0][:, None]
        if columns:
            by_term[:, 1:] *= np.where(rho < nodes[0], rho / nodes[0], 1.0)
        others = zip(moved.items(), made[len(more) :], strict=True)
        return by_term, {name: (one - at) / far for (name, far), one in others}

    def _runs(self, trials: list[tuple[Prony, Given]], rtol: float) -> list[Floats]:
        """Simulate materials with values of the unknowns, and return the observed numbers of each."""
        needed = 1 + max((int(w.max()) for w in (self.touches, self.durations, self.radii) if w.size), default=0)

        def values(role: str, best: float) -> list[float]:
            return [given[self.names[role]] if role in self.names else best for _, given in trials]

        heights = values("height", self.height)
        plate = self.plate
        plates = [plate and replace(plate, mass=mass) for mass in values("plate", plate.mass if plate else 0.0)]
        # Simulations end with the last impact that was observed, or at rest.
        after = _MORE_TIME * (self.last + self.expected_duration)
        stiffer = zip(trials, values("modulus", 1.0), strict=True)
        made = contact.impacts(
            [solid if by == 1.0 else solid.scaled(by) for (solid, _), by in stiffer],
            values("radius", self.radius),
            values("mass", self.mass),
            heights,
            [sqrt(2.0 * height / self.gravity) + after for height in heights],
            needed,
            self.profile,
            rtol,
            gravity=self.gravity,
            plate=plates,
            substrate=self.flat,
        )
        names = ("impact_time", "contact_duration", "peak_contact_radius")
        found = np.stack([made[name].values for name in names], axis=1)
        shared = np.zeros(self.durations.size) if self.shared is None else self.shared
        recorded = zip(found, values("trigger", 0.0), values("pulse", 0.0), values("pixel", 1.0), strict=True)
        numbers = []  # the observed ones, from touch, duration and radius of the impacts
        for columns, late, pulse, scale in recorded:
            touch, lasted, radii = columns[:, np.isfinite(columns[0])]
            if not touch.size:
                raise InputError("the sphere does not bounce: there is nothing to predict")
            last = touch.size - 1
            times = touch[np.minimum(self.touches, last)] - touch[0] - late
            durations = np.where(self.durations <= last, lasted[np.minimum(self.durations, last)], 0.0)
            largest = np.where(self.radii <= last, radii[np.minimum(self.radii, last)], 0.0)
            numbers.append(np.concatenate([times, durations + pulse * shared, scale * largest]))
        return numbers


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
