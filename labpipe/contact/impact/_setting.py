"""The arguments of a drop, checked before anything is computed, its plate, and the scales of its contacts."""

import warnings
from dataclasses import dataclass
from math import inf, isfinite, pi, sqrt
from typing import Any, Literal, get_args

import numpy as np

from labpipe.contact._memory import Creep
from labpipe.contact.impact._rings import Profile
from labpipe.contact.sphere import hertz
from labpipe.errors import InputError
from labpipe.units import Measure, require_positive, si

Solver = Literal["mdr", "rings", "thesis"]

MAX_STEPS = 1_000_000
_UNITS = {"radius": "m", "mass": "kg", "height": "m", "duration": "s", "gravity": "m/s2"}


@dataclass(frozen=True, slots=True)
class Plate:
    """A substrate that vibrates: the plate under the sapphire (thesis, appendix B) as one damped oscillator.

    ``m u'' + c u' + k u = F``, the displacement ``u`` downwards and 0 at rest, ``k = m (2 pi f)^2`` and
    ``c = 2 zeta m (2 pi f)``.

    Parameters
    ----------
    mass : float [kg]
        Modal mass under the contact.
    frequency : float [Hz]
        Undamped natural frequency.
    damping_ratio : float
        Fraction of critical damping, at least 0 and below 1.

    Raises
    ------
    InputError
        A value lies outside its range.

    Examples
    --------
    >>> plate = Plate(mass=2.0, frequency=100.0, damping_ratio=0.02)
    >>> round(plate.stiffness)
    789568
    """

    mass: float
    frequency: float
    damping_ratio: float = 0.0

    def __post_init__(self) -> None:
        require_positive(plate_mass=self.mass, plate_frequency=self.frequency)
        if not 0.0 <= self.damping_ratio < 1.0:
            raise InputError(f"the plate's damping ratio is {self.damping_ratio}, expected 0 to below 1")

    @property
    def stiffness(self) -> float:
        """Stiffness k in N/m."""
        return self.mass * (2.0 * pi * self.frequency) ** 2

    @property
    def damping(self) -> float:
        """Dashpot constant c in N s/m."""
        return 2.0 * self.damping_ratio * self.mass * 2.0 * pi * self.frequency

    def energy(self, displacement: Any, velocity: Any) -> Any:
        """Kinetic and elastic energy [J] of the plate."""
        return 0.5 * (self.mass * velocity**2 + self.stiffness * displacement**2)

    def free(self, u: float, v: float, dt: Any) -> tuple[Any, Any, Any]:
        """Displacement [m], velocity and acceleration after ``dt`` [s] without force, exactly, from those at first."""
        omega = 2.0 * pi * self.frequency
        rate = self.damping_ratio * omega
        damped = omega * sqrt(1.0 - self.damping_ratio**2)
        envelope, c, s = np.exp(-rate * dt), np.cos(damped * dt), np.sin(damped * dt)
        displacement = envelope * (u * c + (v + rate * u) / damped * s)
        velocity = envelope * (v * c - (rate * v + omega**2 * u) / damped * s)
        pull = self.damping * velocity + self.stiffness * displacement
        return displacement, velocity, -pull / self.mass


def modal(plate: Plate | None) -> tuple[float, float, float]:
    """Mass [kg], stiffness [N/m] and damping [N s/m] as compiled steps take them; 0 for rigid ground."""
    return (plate.mass, plate.stiffness, plate.damping) if plate else (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Setting:
    """The arguments of a drop; with ``rows_only`` it ends where the sphere swings too little to lift off again."""

    radius: float
    mass: float
    height: float
    duration: float
    solver: str
    profile: Profile
    rtol: float
    gravity: float
    plate: Plate | None
    ring_width: float | None = None
    full: bool = False
    max_steps: int = MAX_STEPS
    rows_only: bool = False

    def __post_init__(self) -> None:
        """Refuse values out of range, with the reason."""
        for name, unit in _UNITS.items():
            value, low = getattr(self, name), "0 or positive" if name == "height" else "positive"
            if not (isfinite(value) and (value > 0.0 or (value == 0.0 and name == "height"))):
                raise InputError(f"{name} is {value:.6g} {unit}, expected a finite number, {low}")
        for name, known in (("solver", Solver), ("profile", Profile)):
            if getattr(self, name) not in get_args(known):
                raise InputError(f'{name} is "{getattr(self, name)}", expected one of {", ".join(get_args(known))}')
        if not 1e-8 <= self.rtol <= 1e-2:  # below, rounding; above, the estimates of the error mean nothing
            raise InputError(f"rtol is {self.rtol}, expected 1e-08 to 0.01")
        if self.ring_width is not None:
            require_positive("m", ring_width=self.ring_width)
        if self.plate is not None and self.solver == "thesis":
            raise InputError("the thesis's scheme has a rigid substrate; leave the plate out or use another solver")

    @property
    def speed(self) -> float:
        """Speed in m/s at first touch."""
        return sqrt(2.0 * self.gravity * self.height)

    @property
    def fall_time(self) -> float:
        """Time in s from the release to first touch."""
        return sqrt(2.0 * self.height / self.gravity)


@dataclass(frozen=True, slots=True)
class Scales:
    """Estimated duration [s] and largest radius [m] of the first contact; at rest, that under the weight at first.

    ``rest_period``, ``rest_speed`` [s, m/s]: of small oscillations on the static sag, of an amplitude of one sag.
    """

    duration: float
    radius: float
    rest_radius: float
    rest_period: float
    rest_speed: float

    @classmethod
    def of(cls, creep: Creep, one: Setting) -> "Scales":
        """Estimate the scales from Hertz, with the compliance at the time scale itself."""

        def at_rest(compliance: float) -> tuple[float, float]:
            contact = (0.75 * one.mass * one.gravity * one.radius * compliance) ** (1 / 3)
            return contact, 2.0 * pi * sqrt(0.5 * one.mass * compliance / contact)

        period = at_rest(creep.instantaneous)[1]
        for _ in range(3):
            period = at_rest(float(creep.compliance(period / 4)))[1]
        duration, approach, compliance = period, 0.0, creep.instantaneous
        for _ in range(4):
            compliance = float(creep.compliance(duration / 2))
            approach = (15.0 / 16.0 * one.mass * one.speed**2 * compliance / sqrt(one.radius)) ** 0.4
            ballistic = hertz.CONTACT_TIME * approach / one.speed if one.speed > 0.0 else inf
            duration = 1.0 / (1.0 / ballistic + 2.0 / period)
        rest_approach = at_rest(compliance)[0] ** 2 / one.radius
        radius = sqrt(one.radius * (approach + 2.0 * rest_approach))
        rest_radius = at_rest(float(creep.compliance(period / 4)))[0]
        return cls(duration, radius, rest_radius, period, one.gravity * period / (2.0 * pi))


def exact(given: Measure, name: str) -> float:
    """Return an argument in SI; a stated uncertainty is refused."""
    return si(given, _UNITS[name], name)


def warn_of_millimetres(radius: Measure, mass: Measure, height: Measure) -> None:
    """Warn of a sphere of metres, given as a bare number, and show the notation with units."""
    if isinstance(radius, int | float) and 1.0 < radius <= 50.0:  # a larger one is a wish for a flat
        texts = [f'radius="{radius:g} mm"']
        texts += [f'mass="{mass:g} g"'] if isinstance(mass, int | float) and mass > 1 else []
        texts += [f'height="{height:g} mm"'] if isinstance(height, int | float) else []
        message = f"radius={radius:g} is a sphere of {radius:g} m; if millimetres were meant, write {', '.join(texts)}"
        warnings.warn(message, UserWarning, stacklevel=3)
