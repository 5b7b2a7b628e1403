"""The inverse problem: one material, its experiments, and their nuisance parameters."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.identification._evidence import Evidence, Group
from labpipe.identification._parameters import Parameter
from labpipe.identification._spectra import SmoothSpectrum
from labpipe.materials import Prony


@dataclass(frozen=True, slots=True)
class Misfit:
    """Discrepancy of a group's residuals beyond its stated uncertainties.

    ``relative``: Model discrepancy: a further standard deviation, relative to the values. ``correlation``: Of
    neighbouring residuals, 0 to 1; it widens every deviation of the group.
    """

    relative: float = 0.0
    correlation: float = 0.0

    def deviation(self, group: Group) -> Floats:
        """Return the standard deviation (n,) by which residuals are divided."""
        widened = np.hypot(group.u, self.relative * np.abs(group.values))
        return np.asarray(widened * np.sqrt((1.0 + self.correlation) / (1.0 - self.correlation)))


@dataclass(frozen=True, eq=False)
class Problem:
    """A material to be identified.

    ``spectrum``: Family of its spectra. ``evidence``: Experiments on this material. ``nuisances``: Unknowns
    of the experiments. Raises InputError: An experiment depends on an unknown that is not given, or an unknown
    is given twice.
    """

    spectrum: SmoothSpectrum
    evidence: tuple[Evidence, ...]
    nuisances: tuple[Parameter, ...] = ()

    def __post_init__(self) -> None:
        names = [p.name for p in self.parameters]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise InputError(f"the unknowns {', '.join(twice)} are given twice")
        needed = {n for e in self.evidence for n in e.model.unknowns}
        if missing := sorted(needed - set(names)):
            raise InputError(f"no prior is given for: {', '.join(missing)}")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All unknowns: those of the material first."""
        return (*self.spectrum.parameters, *self.nuisances)

    @property
    def window(self) -> tuple[float, float]:
        """Shortest and longest time [s] that the observations cover."""
        windows = [each.model.window for each in self.evidence]
        return min(shortest for shortest, _ in windows), max(longest for _, longest in windows)

    @property
    def n_material(self) -> int:
        """How many unknowns the material has."""
        return len(self.spectrum.parameters)

    def values(self, xi: Floats) -> dict[str, float]:
        """Return the nuisances' values at standard coordinates (parameter,)."""
        own = xi[self.n_material :].tolist()
        return {p.name: p.value(x) for p, x in zip(self.nuisances, own, strict=True)}

    def material(self, xi: Floats) -> Prony:
        """Return the material at standard coordinates (parameter,)."""
        relaxed, *weights = self.spectrum.terms(xi)[0]
        return Prony(float(relaxed), np.array(weights), self.spectrum.rho, nu=self.spectrum.nu)

    @cached_property
    def groups(self) -> tuple[tuple[str, Group, slice], ...]:
        """Name of the experiment, and place among the numbers of all experiments, of every group of observations."""
        named = [(e.name, group) for e in self.evidence for group in e.groups]
        ends = np.cumsum([group.values.size for _, group in named]).tolist()
        return tuple((name, g, slice(end - g.values.size, end)) for (name, g), end in zip(named, ends, strict=True))

    @cached_property
    def observed(self) -> Floats:
        """The numbers (n,) of all experiments."""
        return np.concatenate([group.values for _, group, _ in self.groups])

    def corrections(self, xi: Floats) -> Floats:
        """Return ratios (n,) of the fuller models to the fast ones; 1 where there is none."""
        full, fast = (self.predictions(xi, is_full=is_full) for is_full in (True, False))
        return np.divide(full, fast, out=np.ones(fast.size), where=(fast != 0.0) & (full != 0.0))

    def predictions(self, xi: Floats, *, is_full: bool = False) -> Floats:
        """Return the predictions (n,) of all numbers, in full by the fuller models."""
        solid, given = self.material(xi), self.values(xi)
        return np.concatenate([each.model.predict(solid, given, is_full=is_full) for each in self.evidence])
