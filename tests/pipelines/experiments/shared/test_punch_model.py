"""What indentations share: elastic force, its sensitivities, and the load cell's filter."""

import json

import numpy as np
import pytest
import xarray as xr
from scipy.signal import butter, freqs

from labpipe import contact
from labpipe.contact.line import westergaard
from labpipe.materials import Prony
from labpipe.units import Quantity
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import mach1_readings, punch_model
from pipelines.experiments.shared.material_choice import Variation
from pipelines.experiments.shared.punch_model import Geometry, elastic_force, relative_sources
from pipelines.experiments.shared.punch_settings import IndentationModel, Punch, Substrate

PUNCH = Punch(
    radius=Quantity(2e-3, 2e-6, "m"), period=Quantity(8e-3, 4e-6, "m"), depth=Quantity(6e-3, 6e-6, "m"), tips=3
)
DEPTHS = np.array([0.05e-3, 0.1e-3, 0.3e-3])


def geometry(profile: str, thickness: float | None = None) -> Geometry:
    layer = None if thickness is None else Quantity(thickness, 0.0, "m")
    substrate = Substrate(material="nbr", thickness=layer)
    return Geometry.of(PUNCH, substrate, IndentationModel(profile=profile), 0.5)


@pytest.mark.parametrize("profile", ["parabola", "circle", "cosine"])
def test_the_elastic_force_is_that_of_the_simulator(profile: str) -> None:
    solid = Prony(5e6, [], [], nu=0.5)
    made = contact.indent(solid, 2e-3, 8e-3, 18e-3, np.arange(3.0), DEPTHS, profile=profile, elements=1024)
    found = elastic_force(DEPTHS, geometry(profile)) * 5e6 / 0.75
    np.testing.assert_allclose(found, made["force"].values, rtol=1e-4)


def test_sensitivities_are_those_of_finite_differences() -> None:
    chosen = geometry("parabola")
    found = {s.source: s.sensitivity for s in relative_sources(0.1e-3, 1e-7, chosen)}

    def force(depth: float = 0.1e-3, radius: float = 2e-3, period: float = 8e-3) -> float:
        return float(westergaard.from_displacement(depth, radius, period, 1.0).force)

    base = force()
    assert found["length of a tip"] == pytest.approx(1 / 6e-3)
    assert found["tip radius"] == pytest.approx(
        (force(radius=2.0002e-3) - force(radius=1.9998e-3)) / 0.4e-6 / base, rel=0.01
    )
    assert found["period"] == pytest.approx((force(period=8.001e-3) - force(period=7.999e-3)) / 2e-6 / base, rel=0.01)
    # a touch that lies deeper leaves less indentation
    assert found["first touch"] == pytest.approx(-(force(0.1001e-3) - force(0.0999e-3)) / 0.2e-6 / base, rel=0.01)


def cell(delay: list[float] | None) -> xr.Dataset:
    block = {"filter": {"order": 3.0, "cutoff": 20.0}}
    return xr.Dataset(attrs={"blocks": json.dumps([block]), "filter_delay": json.dumps(delay)})


def test_a_measured_delay_is_that_of_the_lag_with_its_own_uncertainty() -> None:
    slow, lag = (
        mach1_readings.filter_delay(cell([17.5e-3, 0.2e-3])),
        mach1_readings.force_lag(cell([17.5e-3, 0.2e-3]), 2.0),
    )
    assert (slow.value, slow.u) == pytest.approx((17.5e-3, 0.2e-3), rel=1e-4)
    assert lag.u_phase == pytest.approx(2 * np.pi * 2.0 * 0.2e-3, rel=0.02)
    assert mach1_readings.filter_delay(cell(None)).u > 0.5e-3  # of the usual types


def test_a_filtered_sinusoid_has_the_gain_and_lag_of_the_analogue_filter() -> None:
    frequency, interval = 2.0, 0.01
    time = np.arange(0, 6, interval)
    readings = {"block": ("sample", 0 * time), "sampling_interval": ("block_index", [interval])}
    passed = mach1_readings.passed(cell(None).assign(readings), np.sin(2 * np.pi * frequency * time))
    numerator, denominator = butter(3, 2 * np.pi * 20.0, analog=True)
    _, response = freqs(numerator, denominator, [2 * np.pi * frequency])
    late = time > 3
    known = np.abs(response[0]) * np.sin(2 * np.pi * frequency * time + np.angle(response[0]))
    np.testing.assert_allclose(passed[late], known[late], atol=3e-3)


def test_a_changed_modulus_and_a_deeper_touch_change_the_force_by_as_much_as_a_simulation_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    time = np.linspace(0.0, 1.0, 40)
    loads = xr.Dataset(
        {"position_z": ("sample", 0.3e-3 * time), "time": ("sample", time), "block": ("sample", 0 * time)},
        attrs={"blocks": json.dumps([{"start": "2026-01-01T10:00:00"}])},
    )
    substrate, chosen = Substrate(material="nbr"), IndentationModel(profile="parabola")
    settings = Harmonic(kind="harmonic", mach1="x", punch=PUNCH, substrate=substrate, model=chosen)
    soft, stiff = (Prony(E, [], [], nu=0.5) for E in (5e6, 5.5e6))
    others = {"modulus": Variation(Quantity(5e6, 1e5, "Pa"), 0.5e6, stiff)}
    monkeypatch.setattr(punch_model, "resolve", lambda *_: soft)
    monkeypatch.setattr(punch_model, "variations", lambda *_: others)

    def simulated(touch: float) -> xr.Dataset:
        found = xr.Dataset({"contact_position": touch, "u_contact_position": 5e-6})
        return punch_model.model(loads, found, None, None, settings=settings)

    made = simulated(0.0)
    force = made["force"].values
    np.testing.assert_allclose(made["slope"].sel(uncertain="modulus") * 5e6, force, atol=2e-2 * force.max())
    deeper = simulated(5e-6)
    change = made["slope"].sel(uncertain="first touch") * 5e-6
    np.testing.assert_allclose(change, deeper["force"] - force, atol=2e-3 * force.max())
