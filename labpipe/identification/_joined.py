"""Several forward models concatenated into the model of one experiment."""

from dataclasses import dataclass

import numpy as np

from labpipe.arrays import Floats
from labpipe.identification._evidence import Given, Model
from labpipe.materials import Prony


@dataclass(frozen=True, eq=False)
class JoinedModel:
    """Numbers of several models without corrections, one behind the other."""

    parts: tuple[Model, ...]

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Unknowns of all parts, each once."""
        return tuple(dict.fromkeys(n for part in self.parts for n in part.unknowns))

    @property
    def window(self) -> tuple[float, float]:
        """Shortest and longest time of all parts [s]."""
        windows = [part.window for part in self.parts]
        return min(w[0] for w in windows), max(w[1] for w in windows)

    def predict(self, material: Prony, given: Given) -> Floats:
        """Return the numbers (n,) of all parts."""
        return np.concatenate([part.predict(material, given) for part in self.parts])

    def derivatives(self, material: Prony, given: Given) -> tuple[Floats, dict[str, Floats]]:
        """Return the derivatives of all parts; see :meth:`Model.derivatives`."""
        made = [part.derivatives(material, given) for part in self.parts]
        sizes = [len(by_term) for by_term, _ in made]
        others = {
            name: np.concatenate([own.get(name, np.zeros(n)) for (_, own), n in zip(made, sizes, strict=True)])
            for name in self.unknowns
        }
        return np.vstack([by_term for by_term, _ in made]), others

    def by_times(self, material: Prony, given: Given, rho: Floats) -> Floats:
        """Return the derivatives of all parts; see :meth:`Model.by_times`."""
        return np.vstack([part.by_times(material, given, rho) for part in self.parts])

    def refined(self, material: Prony, given: Given) -> None:
        """No part has a fuller model."""
        del material, given
