"""Observations of one experiment, and the forward model that predicts them from a material.

One :class:`Evidence` is one experiment: groups of numbers with their own, independent standard
uncertainties, and a model. A height, a trigger, a zero or a scale that several numbers share is
not part of their uncertainties: it is an unknown of the problem, with a prior.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials import Prony

Given = Mapping[str, float]
Fuller = Callable[[Prony, Given], Floats]
"""A fuller model of linear numbers (n,), without factors and offsets."""


@dataclass(frozen=True, eq=False)
class Group:
    """Observed numbers of one kind.

    ``name``: Such as "time of touch". ``values``, ``u`` (n,): Observed, with independent standard uncertainties, in
    ``units``. ``axis`` (n,): Abscissa of their chart. ``units``, ``axis_units``, ``axis_name``: SI. Raises
    InputError: A value is not finite, or an uncertainty not positive.
    """

    name: str
    values: Floats
    u: Floats
    axis: Floats
    units: str
    axis_name: str
    axis_units: str

    def __post_init__(self) -> None:
        shapes = {self.values.shape, self.u.shape, self.axis.shape}
        good = np.isfinite(self.values) & np.isfinite(self.u) & (self.u > 0.0)
        if len(shapes) > 1 or self.values.ndim != 1 or not self.values.size or not good.all():
            raise InputError(
                f"{self.name}: expected as many finite values as positive uncertainties and "
                f"places, found {int(good.sum())} good ones of {self.values.size}"
            )


class Model(Protocol):
    """Predicts the numbers of one experiment."""

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the nuisance parameters on which it depends."""

    @property
    def window(self) -> tuple[float, float]:
        """Shortest and longest time in s on which the observations depend."""

    def predict(self, material: Prony, given: Given, *, is_full: bool = False) -> Floats:
        """Return the numbers (n,) of all groups, one behind the other; in full by a costlier model, if there is one."""

    def derivatives(self, material: Prony, given: Given) -> tuple[Floats, dict[str, Floats]]:
        """Return the derivatives by the terms (E_relaxed, E), (n, 1 + term) [per Pa], and by the unknowns, (n,)."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """One experiment.

    ``name``: Of the experiment. ``model``: Its numbers are those of the groups, in order. ``is_prior``: It is known
    beforehand (a rheometer's moduli) and shows on the page as prior.
    """

    name: str
    groups: tuple[Group, ...]
    model: Model
    is_prior: bool = False

    @property
    def values(self) -> Floats:
        """Observed numbers (n,) of all groups."""
        return np.concatenate([g.values for g in self.groups])


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Numbers that are linear in the terms of the relaxation modulus.

    ``prediction = factors · (basis + Σ shift · shifts) @ (E_relaxed, E) + offsets``, which holds
    for the force of a growing contact (Lee and Radok), for dynamic stiffness at small amplitude,
    and for moduli. Derivatives are exact.

    ``basis`` (n, 1 + term): Prediction per Pa of each term. ``window`` [s]: Shortest and longest time of which the
    numbers depend on. ``shifts``: Derivative of the basis by an unknown whose best value is 0, such as a zero of depth.
    ``factors``: Unknowns, 1 at best, by which all numbers are multiplied. ``offsets``: Derivative of the numbers by
    an unknown, 0 at best, that only adds. ``fuller``: Takes material and given.
    """

    basis: Floats
    window: tuple[float, float]
    shifts: Mapping[str, Floats] = field(default_factory=dict)
    factors: tuple[str, ...] = ()
    offsets: Mapping[str, Floats] = field(default_factory=dict)
    fuller: Fuller | None = None

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Shifts, factors and offsets."""
        return (*self.shifts, *self.factors, *self.offsets)

    def predict(self, material: Prony, given: Given, *, is_full: bool = False) -> Floats:
        """Return the numbers (n,), in full by the fuller model, if there is one."""
        factor, basis, offset = self._parts(given)
        if is_full and self.fuller is not None:
            return np.asarray(factor * self.fuller(material, given) + offset)
        return np.asarray(factor * (basis @ np.append(material.E_relaxed, material.E)) + offset)

    def derivatives(self, material: Prony, given: Given) -> tuple[Floats, dict[str, Floats]]:
        """Return exact derivatives; see :meth:`Model.derivatives`."""
        terms = np.append(material.E_relaxed, material.E)
        factor, basis, _ = self._parts(given)
        others = {name: factor * (shift @ terms) for name, shift in self.shifts.items()}
        others |= {name: factor * (basis @ terms) / given[name] for name in self.factors}
        return factor * basis, others | dict(self.offsets)

    @classmethod
    def stacked(cls, parts: Sequence["LinearModel"]) -> "LinearModel":
        """Return the numbers of several models of the same factors, one behind the other, without a fuller model."""
        shifts, offsets = ({n: None for part in parts for n in getattr(part, of)} for of in ("shifts", "offsets"))
        return cls(
            np.vstack([part.basis for part in parts]),
            (min(part.window[0] for part in parts), max(part.window[1] for part in parts)),
            {n: np.vstack([part.shifts.get(n, np.zeros_like(part.basis)) for part in parts]) for n in shifts},
            parts[0].factors,
            {n: np.concatenate([part.offsets.get(n, np.zeros(len(part.basis))) for part in parts]) for n in offsets},
        )

    def _parts(self, given: Given) -> tuple[float, Floats, Floats]:
        """Return factor, basis (n, 1 + term) and offset (n,) at values of the unknowns."""
        basis, offset = self.basis, np.zeros(len(self.basis))
        for name, shift in self.shifts.items():
            basis = basis + given[name] * shift
        for name, added in self.offsets.items():
            offset = offset + given[name] * added
        return math.prod(given[name] for name in self.factors), basis, offset
