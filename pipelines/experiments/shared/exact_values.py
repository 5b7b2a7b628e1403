"""Values that a session states without an uncertainty."""

from decimal import Decimal
from typing import Any

from labpipe.units import Quantity, spellings, unit
from labpipe.workflow.fields import every_setting

_MEASURED = (
    "height", "radius", "mass", "temperature", "nu", "depth", "thickness", "period", "frequency", "damping_ratio",
    "wavelength", "contact",
)  # fmt: skip
"""Names of settings that hold a measured value."""


def exact_values(settings: Any) -> list[str]:
    """Return the names of measured values that are stated without an uncertainty, each once.

    ``sphere.mass`` and every ``loads[0].mass`` are ``"mass"``.
    """
    found = (
        place.rpartition(".")[2]
        for place, value, _ in every_setting(settings)
        if isinstance(value, Quantity) and value.u == 0.0 and value.value != 0.0
    )
    return [name.replace("_", " ") for name in dict.fromkeys(found) if name in _MEASURED]


def usual_uncertainty(given: Quantity) -> float:
    """Return half a unit of the last digit of a value [SI], in the unit in which it is a number from 1 to 1000.

    Examples
    --------
    >>> given = Quantity(9.525e-3, 0.0, "m"), Quantity(0.505, 0.0, "kg"), Quantity(20.0, 0.0, "degC")
    >>> [f"{usual_uncertainty(each):.1e}" for each in given]
    ['5.0e-07', '5.0e-04', '5.0e-01']
    """
    factors = (unit(name).factor for name in spellings(given.si) if name != "cm")
    factor = next((f for f in sorted(factors, reverse=True) if 1.0 <= abs(given.value / f) < 1000.0), 1.0)
    decimals = Decimal(f"{abs(given.value) / factor:.6g}").normalize().as_tuple().exponent
    return 0.5 * factor * 10.0 ** min(int(decimals), 0)
