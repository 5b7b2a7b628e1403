"""tamaas (boundary elements with FFT), the optional peer for elastic contacts.

https://doi.org/10.21105/joss.02121. A new model is made for every call: a second solution with the
same one would start from the first and take no time.
"""

from typing import Any

import numpy as np

from labpipe.arrays import Floats

_LINE_TOLERANCE, _SPHERE_TOLERANCE = 1e-12, 1e-10
#: Mean pressure over that of full contact.
_MEAN = 0.2


def line(points: int) -> Floats:
    """Return the pressure (point,) under a cosine over its mean, centred on the tip."""
    tamaas = _quiet()
    model = tamaas.ModelFactory.createModel(tamaas.model_type.basic_1d, [1.0], [points])
    model.E, model.nu = 1.0, 0.0
    x = np.arange(points) / points
    mean = _MEAN * np.pi
    pressure = _solved(tamaas, model, np.cos(2.0 * np.pi * x) - 1.0, mean, _LINE_TOLERANCE)
    return np.roll(pressure.ravel(), points // 2) / mean


def _quiet() -> Any:
    import tamaas

    tamaas.set_log_level(tamaas.LogLevel.error)
    return tamaas


def _solved(tamaas: Any, model: Any, surface: Floats, mean: float, tolerance: float, operator: str = "") -> Floats:
    pressure = tamaas.PolonskyKeerRey.pressure
    solver = tamaas.PolonskyKeerRey(model, surface, tolerance, pressure, pressure)
    if operator:
        solver.setIntegralOperator(operator)
    solver.solve(mean)
    return np.array(model.traction)
