"""A rheometer's moduli as prior of the identification of a material."""

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.identification import Evidence, modulus_evidence
from pipelines.experiments.shared.material_choice import fitted_at
from pipelines.experiments.shared.material_evidence import MaterialEvidence, nuisance


def prior(
    sweeps: xr.Dataset,
    master_curve: xr.Dataset,
    *,
    name: str,
    temperature: float | None,
    specimen: float = 0.05,
    noise: tuple[float, float] = (0.01, 0.03),
    per_decade: int = 2,
) -> MaterialEvidence:
    """Return the moduli at the temperature [degC] of other experiments, as prior, a few ``per_decade`` of frequency.

    Relative uncertainties are those that clamp and size of the ``specimen`` leave, and the ``noise`` of storage and
    loss modulus. The spectrum must reach as far as they do: one that ends before could not explain them.
    """
    solid = fitted_at(master_curve, temperature)
    frequency = sweeps["frequency"].values
    shift = 10.0 ** master_curve["log10_aT"].values
    own = float(solid.rho[0] / master_curve["rho"].values[0]) if len(solid.rho) else 1.0
    low = float(frequency.min() * shift.min() / own)
    high = float(frequency.max() * shift.max() / own)
    places = np.geomspace(low, high, max(int(np.log10(high / low) * per_decade), 2))
    modulus = solid.complex_modulus(2.0 * np.pi * places)
    u = [noise[0] * modulus.real, noise[1] * modulus.imag]
    scale = nuisance(f"{name} specimen", 1.0, specimen, "1", "size of the rheometer's specimen")

    def build(rho: Floats) -> Evidence:
        return modulus_evidence(name, places, (modulus.real, u[0]), (modulus.imag, u[1]), rho, factors=(scale.name,))

    return MaterialEvidence(float(solid.nu), (0.5 / np.pi / high, 0.5 / np.pi / low), (scale,), build)
