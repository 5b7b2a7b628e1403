"""The other body of a contact: rigid, or elastic with a compliance of its own.

Two half-spaces deform by the sum of their compliances, ``(1 - nu^2) J(t) + (1 - nu_s^2)/E_s``: exact within the theory
of small contacts, for any history (K. L. Johnson, Contact Mechanics, 1985, section 4.2,
doi:10.1017/CBO9781139171731).
"""

from typing import NamedTuple

from labpipe.errors import InputError
from labpipe.units import Measure, si


class CounterBody(NamedTuple):
    """An elastic counter-body: Young's modulus [Pa] with its standard uncertainty, Poisson's ratio, source."""

    E: float
    nu: float
    u_E: float
    source: str

    @property
    def compliance(self) -> float:
        """Contact compliance (1 - nu^2)/E in 1/Pa."""
        return (1.0 - self.nu**2) / self.E


COUNTER_BODIES = {
    "sapphire": CounterBody(
        403e9,
        0.235,
        10e9,
        "Hill's average over all directions of the single crystal's constants C11 497, C12 163, C13 116, |C14| 22, "
        "C33 501, C44 147 GPa at 300 K: T. Goto, O. L. Anderson, I. Ohno, S. Yamamoto, J. Geophys. Res. 94 (1989) "
        "7588, doi:10.1029/JB094iB06p07588; u is wider than the bounds of Voigt and Reuss, 398 and 408 GPa",
    )
}

Substrate = str | tuple[Measure, float] | CounterBody | None
"""A name of :data:`COUNTER_BODIES`, (Young's modulus [Pa], Poisson's ratio), a counter-body, or None: rigid."""


def counter_body(substrate: Substrate) -> CounterBody | None:
    """Counter-body by its name or its numbers; None is a rigid one.

    Raises
    ------
    InputError
        The name is unknown, or a number is out of range.

    Examples
    --------
    >>> counter_body("sapphire").E, counter_body(("70 GPa", 0.22)).E
    (403000000000.0, 70000000000.0)
    """
    if substrate is None or isinstance(substrate, CounterBody):
        return substrate
    if isinstance(substrate, str):
        if substrate not in COUNTER_BODIES:
            known = ", ".join(f'"{name}"' for name in COUNTER_BODIES)
            raise InputError(
                f"substrate \"{substrate}\" is unknown; use {known}, (Young's modulus, Poisson's ratio), or None: rigid"
            )
        return COUNTER_BODIES[substrate]
    if not (isinstance(substrate, tuple | list) and len(substrate) == 2):
        raise InputError("substrate: expected a name, (Young's modulus, Poisson's ratio), or None for a rigid one")
    modulus, nu = si(substrate[0], "Pa", "substrate"), si(substrate[1], "1", "substrate")
    if not (0.0 < modulus < float("inf") and -1.0 < nu <= 0.5):
        raise InputError(
            f"substrate: Young's modulus {modulus:g} Pa and Poisson's ratio {nu:g}; expected a positive "
            "modulus and a ratio above -1 and at most 0.5"
        )
    return CounterBody(modulus, nu, 0.0, "given")


def counter_compliance(substrate: Substrate) -> float:
    """Contact compliance of a counter-body in 1/Pa, see :func:`counter_body`; 0 of a rigid one."""
    body = counter_body(substrate)
    return 0.0 if body is None else body.compliance
