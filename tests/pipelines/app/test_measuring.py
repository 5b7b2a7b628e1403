"""Lengths between two clicks: against rulers whose graduations are known, and what is refused."""

import math

import numpy as np
import pytest
from scipy.special import erf

from labpipe.errors import InputError
from pipelines.app._measuring import length

BEGIN = np.array([60.3, 60.7])


def ruler(angle: float, separation: float, kind: str, rng: np.random.Generator, noise: float = 2.0) -> np.ndarray:
    """Draw two graduations, or the two edges of a body, with a graduation between them."""
    y, x = np.mgrid[:300, :520].astype(float)
    t = (x - BEGIN[0]) * math.cos(angle) + (y - BEGIN[1]) * math.sin(angle)
    if kind == "graduation":
        places = (0.0, 0.5 * separation, separation)
        grey = 200 - 120 * sum(np.exp(-0.5 * ((t - at) / 1.2) ** 2) for at in places)
    else:
        grey = 60 + 70 * (erf(t / 1.7) - erf((t - separation) / 1.7))
    return np.round(np.clip(grey + rng.normal(0, noise, grey.shape), 0, 255))


@pytest.mark.parametrize("kind", ["graduation", "edge"])
@pytest.mark.parametrize("angle", [0.0, math.radians(17)])
def test_two_clicks_give_the_length_within_its_uncertainty(kind: str, angle: float) -> None:
    z, errors = [], []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        separation = 380 + rng.uniform(0, 1)
        grey = ruler(angle, separation, kind, rng)
        end = BEGIN + separation * np.array([math.cos(angle), math.sin(angle)])
        found = length(grey, tuple(BEGIN + rng.uniform(-3, 3, 2)), tuple(end + rng.uniform(-3, 3, 2)))
        assert found.found == (kind, kind)
        errors.append(found.value - separation)
        z.append(errors[-1] / found.u)
    assert max(map(abs, errors)) < 0.06  # px, from clicks that are off by up to 4 px
    assert max(map(abs, z)) < 5
    assert np.sqrt(np.mean(np.square(z))) < 2


def test_what_cannot_be_measured_is_refused() -> None:
    rng = np.random.default_rng(0)
    grey = ruler(0.0, 380.0, "edge", rng)
    with pytest.raises(InputError, match="at least 48 px apart"):
        length(grey, (60, 60), (70, 60))
    with pytest.raises(InputError, match="too near to the border"):
        length(grey, (3, 60), (440, 60))
    with pytest.raises(InputError, match="nothing is found at"):
        length(grey, (200, 60), (440, 60))
    with pytest.raises(InputError, match="px apart"):
        length(grey, (math.nan, 60), (440, 60))
