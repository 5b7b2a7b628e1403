"""Thermal properties of the library's materials, for estimates of self-heating.

Typical values of handbooks at room temperature; grades differ by a tenth and more. Nothing here
was measured on a specimen.
"""

from dataclasses import dataclass

from labpipe.errors import InputError
from labpipe.materials.library._library import describe
from labpipe.units import require_positive


@dataclass(frozen=True, slots=True)
class Thermal:
    """Thermal properties of a solid.

    Attributes
    ----------
    density : float [kg/m3]
    heat_capacity : float [J/(kg K)]
        At constant pressure.
    conductivity : float [W/(m K)]
    source, status : str
        Where the numbers come from: measured, datasheet or estimate.
    """

    density: float
    heat_capacity: float
    conductivity: float
    source: str = "given"
    status: str = "measured"

    def __post_init__(self) -> None:
        require_positive(density=self.density, heat_capacity=self.heat_capacity, conductivity=self.conductivity)

    @property
    def diffusivity(self) -> float:
        """Thermal diffusivity in m2/s."""
        return self.conductivity / (self.density * self.heat_capacity)


_HANDBOOK = "typical value of handbooks at 23 degC; the density is that of the library"
_KNOWN = {
    "nbr": (1950.0, 0.25),
    "acrylic": (1470.0, 0.19),
    "peek": (1340.0, 0.29),
    "nylon": (1700.0, 0.25),
    "ptfe": (1000.0, 0.25),
}


def thermal(name: str) -> Thermal:
    """Return the thermal properties of a material of the library.

    Raises
    ------
    InputError
        There are none of that name.

    Examples
    --------
    >>> round(thermal("acrylic").diffusivity * 1e6, 3)
    0.11
    """
    if name not in _KNOWN:
        raise InputError(
            f'no thermal properties of "{name}" are known, only of {", ".join(_KNOWN)}; give its '
            "density, heat capacity and conductivity"
        )
    density = next(e.value for e in describe(name).entries if e.name == "density")
    return Thermal(density, *_KNOWN[name], source=_HANDBOOK, status="estimate")
