"""Inputs of ``simulate`` and ``sweep``: a material by its name, and a load history."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from labpipe.units import require_positive

if TYPE_CHECKING:
    from labpipe.materials import Prony, Thermal

_RAMP_SAMPLES, _HOLD_SAMPLES = 41, 120
_FIRST_HOLD, _SHORTEST_HOLD = 1e-3, 2e-3  # s; a hold is sampled by equal ratios


def material(name: str, temperature: float | None = None, vertical_shift: float = 1.0) -> "Prony":
    """Return the solid of a material at a temperature [degC], all moduli times a vertical shift.

    It is one of the library, or of a TOML file when the name ends in ``.toml``.
    """
    from labpipe import materials

    solid = materials.load(name, temperature)
    return solid if vertical_shift == 1.0 else solid.scaled(vertical_shift)


def thermal_of(name: str, heat_capacity: float | None, conductivity: float | None) -> "Thermal":
    """Return the thermal properties of a material; what is not given is the library's.

    Raises
    ------
    InputError
        It is not of the library, and its file or the arguments do not say all three.
    """
    from labpipe.errors import InputError
    from labpipe.materials import Thermal, describe, thermal

    if heat_capacity is None and conductivity is None:
        return thermal(name)
    density = next((e.value for e in describe(name).entries if e.name == "density"), None)
    known = None if name.endswith(".toml") else thermal(name)
    capacity = heat_capacity or (known.heat_capacity if known else None)
    conducts = conductivity or (known.conductivity if known else None)
    if density is None or capacity is None or conducts is None:
        message = f"{name}: self-heating needs a density (in the file), a heat capacity and a conductivity, all three"
        raise InputError(message)
    return Thermal(density, capacity, conducts)


def ramp_hold_oscillation(
    mean: float, amplitude: float, frequency: float, cycles: int, *, hold: float, ramp: float, per_cycle: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sample a punch that presses in, holds, then oscillates: time [s] and displacement [m], both (n,).

    It presses with the speed ``ramp`` [m/s] to the mean indentation [m]; 0 cycles end with the hold [s], else the
    last one, of ``per_cycle`` samples as all are, ends the history.
    """
    require_positive("in SI units", mean=mean, frequency=frequency, ramp=ramp)
    pressed = np.linspace(0.0, mean / ramp, _RAMP_SAMPLES)
    held = pressed[-1] + np.geomspace(_FIRST_HOLD, max(hold, _SHORTEST_HOLD), _HOLD_SAMPLES)
    swing = held[-1] + np.linspace(0, cycles / frequency, per_cycle * cycles + 1)[1:]
    swings = mean + amplitude * np.sin(2 * np.pi * frequency * (swing - held[-1]))
    displacement = np.concatenate([pressed * ramp, np.full(held.size, mean), swings])
    return np.concatenate([pressed, held, swing]), displacement
