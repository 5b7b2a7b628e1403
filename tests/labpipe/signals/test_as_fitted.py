"""What a fit finds in a simulated drop, against what it finds in records of that drop."""

import numpy as np
import pytest
import xarray as xr

from labpipe import contact, signals

_INTERVAL, _NOISE = 5e-5, 1e-6
_RECORDS = 8


@pytest.fixture(scope="module")
def simulated() -> xr.Dataset:
    times = np.arange(0.0, 0.12, _INTERVAL)
    return contact.drop("ptfe", 9.525e-3, 0.505, 7e-3, 0.12, times=times)


def fitted(made: xr.Dataset, count: int) -> xr.Dataset:
    lasts = made["contact_duration"].values
    options = {"noise": _NOISE, "gravity": 9.81, "u_gravity": 0.01, "contact": "polymer"}
    return signals.as_fitted(made["displacement"], made["impact_time"].values[: lasts.size], lasts, count, **options)


@pytest.fixture(scope="module")
def seen(simulated: xr.Dataset) -> xr.Dataset:
    return fitted(simulated, 2)


@pytest.fixture(scope="module")
def found(simulated: xr.Dataset) -> list[xr.Dataset]:
    """Return the bounces of records of it, each with noise of its own and at rest before the release."""
    held = np.full(400, float(simulated["displacement"][0]))
    moved = np.concatenate([held, simulated["displacement"].values])
    random = np.random.default_rng(5)
    made = []
    for _ in range(_RECORDS):
        noisy = moved + _NOISE * random.standard_normal(moved.size)
        record = xr.DataArray(noisy, {"time": _INTERVAL * np.arange(moved.size)}, dims="time", attrs={"units": "m"})
        made.append(signals.bounces(record, contact="polymer"))
    return made


@pytest.mark.filterwarnings("ignore:the record ends:UserWarning")
@pytest.mark.parametrize("name", ["restitution", "contact_duration", "incoming_speed", "penetration"])
def test_records_scatter_about_it_and_not_about_the_truth(
    simulated: xr.Dataset, seen: xr.Dataset, found: list[xr.Dataset], name: str
) -> None:
    values = np.array([one[name].values[:2] for one in found])
    mean, error = values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(_RECORDS)
    # The 99.9 % point of Student's t with seven degrees of freedom.
    assert np.all(np.abs(mean - seen[name].values) < 5.4 * error)


def test_a_flight_that_ends_in_a_contact_without_lift_off_does_not_spoil_the_impact_before() -> None:
    # The last impacts of a soft sphere from a small height: flights of a few ms, and then it stays.
    made = contact.drop("ptfe", 9.525e-3, 0.505, 1.5e-3, 0.08, times=np.arange(0.0, 0.08, _INTERVAL))
    seen = fitted(made, made.sizes["impact"])
    ratio = seen["contact_duration"].values / made["contact_duration"].values
    assert np.isfinite(ratio[:2]).all()
    assert np.all(np.abs(ratio[np.isfinite(ratio)] - 1.0) < 0.1)
