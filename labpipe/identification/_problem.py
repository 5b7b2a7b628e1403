"""The inverse problem: one material, its experiments, and their nuisance parameters."""

from dataclasses import dataclass, replace

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.identification._evidence import Evidence, Group
from labpipe.identification._parameters import Parameter
from labpipe.identification._spectra import SmoothSpectrum, material
from labpipe.materials import Prony

Corrections = tuple[Floats, ...]


@dataclass(frozen=True, slots=True)
class Misfit:
    """Discrepancy of a group's residuals beyond its stated uncertainties.

    ``relative``: Model discrepancy: a further standard deviation, relative to the prediction. ``correlation``: Of
    neighbouring residuals, 0 to 1; it widens every deviation of the group.
    """

    relative: float = 0.0
    correlation: float = 0.0

    def deviation(self, group: Group, predicted: Floats) -> Floats:
        """Return the standard deviation (n,) by which residuals are divided."""
        widened = np.hypot(group.u, self.relative * np.abs(predicted))
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
    def n_material(self) -> int:
        """How many unknowns the material has."""
        return len(self.spectrum.parameters)

    def nuisance_values(self, xi: Floats) -> dict[str, float]:
        """Return the nuisances' values at standard coordinates (parameter,)."""
        own = xi[self.n_material :].tolist()
        return {p.name: p.value(x) for p, x in zip(self.nuisances, own, strict=True)}

    def material(self, xi: Floats) -> Prony:
        """Return the material at standard coordinates (parameter,)."""
        return material(self.spectrum, self.spectrum.log_terms(xi[: self.n_material]))

    def only(self, *, prior: bool) -> "Problem":
        """Return the same problem with the evidence known beforehand alone, or without it."""
        kept = tuple(e for e in self.evidence if e.is_prior == prior)
        return replace(self, evidence=kept)

    def no_corrections(self) -> Corrections:
        """Return that every fast model is taken as it is."""
        return tuple(np.ones(e.values.size) for e in self.evidence)

    def corrections(self, xi: Floats) -> Corrections:
        """Return ratios (n,) of the fuller models to the fast ones; 1 where there is none."""
        solid, given = self.material(xi), self.nuisance_values(xi)
        made = []
        for each in self.evidence:
            fuller, ratio = each.model.refined(solid, given), np.ones(each.values.size)
            if fuller is not None:
                fast = each.model.predict(solid, given)
                np.divide(fuller, fast, out=ratio, where=(fast != 0.0) & (fuller != 0.0))
            made.append(ratio)
        return tuple(made)

    def predictions(self, xi: Floats, corrections: Corrections) -> list[Floats]:
        """Return the numbers (n,) of every experiment."""
        solid, given = self.material(xi), self.nuisance_values(xi)
        return [
            ratio * each.model.predict(solid, given) for each, ratio in zip(self.evidence, corrections, strict=True)
        ]


def split_by_group(evidence: Evidence, numbers: Floats) -> list[Floats]:
    """Cut the numbers of an experiment into those of its groups (along the first axis)."""
    ends = np.cumsum([g.values.size for g in evidence.groups])
    return list(np.split(numbers, ends[:-1]))
