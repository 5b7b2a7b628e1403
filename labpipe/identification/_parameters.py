"""Unknown parameters with their priors, in coordinates in which the prior is standard normal.

Every parameter has a standard coordinate ``xi`` with prior mean 0 and standard deviation 1, and
the unknowns of a problem are independent a priori. So the rows of a Jacobian are comparable, the
prior is one residual per unknown, and a singular value of the data's Jacobian says how much more
the data know of a combination than the prior does.
"""

from dataclasses import dataclass
from math import exp, isfinite

from labpipe.errors import InputError


@dataclass(frozen=True, slots=True)
class Parameter:
    """One unknown and its prior.

    ``name``: Unique in a problem. ``mean``, ``sd``: Of the prior: of the value, or of its natural logarithm where
    ``is_log``. ``unit``: SI, of the value. ``text``: Its meaning. ``is_log``: The prior is normal in the logarithm.
    ``is_nuisance``: It belongs to an experiment, not to the material. Raises InputError: Mean or standard deviation
    are not finite, or the latter is not positive.

    Examples
    --------
    >>> height = Parameter("height", 1.5e-3, 5e-6, "m", "height of the drop", is_nuisance=True)
    >>> round(height.value(1.0) * 1e3, 4)
    1.505
    """

    name: str
    mean: float
    sd: float
    unit: str
    text: str
    is_log: bool = False
    is_nuisance: bool = False

    def __post_init__(self) -> None:
        if not (isfinite(self.mean) and isfinite(self.sd) and self.sd > 0.0):
            raise InputError(
                f"{self.name}: a prior of {self.mean} with standard deviation {self.sd} is none; "
                "expected finite numbers and a positive deviation"
            )

    def value(self, xi: float) -> float:
        """Return the value at a standard coordinate, in ``unit``."""
        natural = self.mean + self.sd * xi
        return exp(natural) if self.is_log else natural

    def slope(self, xi: float) -> float:
        """Return the derivative of the value by the standard coordinate."""
        return self.sd * self.value(xi) if self.is_log else self.sd
