import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from labpipe.contact import drop
from labpipe.errors import InputError
from labpipe.materials import load
from labpipe.signals import bounces
from tests.by_day import by_day

ACRYLIC = {"loss": 0.5}
LOSSY = {"loss": 3.0, "dent": 0.3}
MATERIALS = (
    ACRYLIC,
    LOSSY,
    {"loss": 1.2, "height": 5e-3},
    {"loss": 0.3, "height": 10e-3, "plate_mass": 50.0},
    {"loss": 0.15, "dent": 0.2, "height": 7e-3},
)
STILL_MOVING = "ignore:the record ends before the body is at rest"


@pytest.fixture(scope="module")
def lossy(bouncing, measure):
    truth = bouncing(**LOSSY)
    record = measure(truth, 20e3, 1e-6)[0]
    return truth, record, bounces(record)


@pytest.mark.filterwarnings(STILL_MOVING)
@pytest.mark.parametrize("material", by_day(MATERIALS, 3))
def test_first_contact_within_two_samples(bouncing, measure, material):
    truth = bouncing(**material)
    found = bounces(measure(truth, 20e3, 1e-6)[0])
    assert float(found.first_contact_time) == pytest.approx(truth.touch[0], abs=2 / 20e3)
    assert float(found.release_time) == pytest.approx(truth.release, abs=2 / 20e3)
    height = material.get("height", 1.5e-3)
    assert float(found.drop_height) == pytest.approx(height, abs=4 * float(found.u_drop_height))
    assert float(found.fall_acceleration) == pytest.approx(9.81, rel=1e-3)


def test_bounces_until_flights_are_a_few_micrometres_high(lossy):
    truth, _, found = lossy
    n = found.sizes["impact"]
    assert n >= 12
    assert 9.81 * (truth.touch[n] - truth.liftoff[n - 1]) ** 2 / 8 < 6e-6
    np.testing.assert_allclose(found.touch_time[:13], truth.touch[:13], atol=1e-4)
    z_touch = (found.touch_time - truth.touch[:n]) / found.u_touch_time  # of the 14th, 67 us: 2.4
    z = (found.restitution - truth.outgoing[:n] / truth.incoming[:n]) / found.u_restitution
    assert np.abs(z_touch).max() < 3.0
    assert np.sqrt(np.mean(z_touch**2)) < 1.5
    assert np.sqrt(np.mean(z**2)) < 1.5


def test_phases_follow_the_motion(lossy):
    truth, record, found = lossy
    time = record["time"].values
    ends = [float(found[f"{name}_time"]) for name in ("release", "first_contact", "settling", "rest")]
    assert np.all(np.diff([time[0], *ends, time[-1]]) > 0)
    assert ends[0] >= truth.release - 1e-4
    assert ends[1] <= truth.touch[0] + 1e-4
    assert ends[2] >= truth.touch[10]
    speed = truth.sample(time)[1]
    assert np.abs(speed[time >= ends[3]]).max() < 0.015 * truth.incoming[0]
    assert float(found.rest_level) == pytest.approx(record.values[-2000:].mean(), abs=5e-7)


def test_downward_positive_record_with_offset_of_any_scale_gives_the_same(lossy):
    _, record, found = lossy
    turned = bounces((2e-3 - np.cos(0.35) * record).assign_attrs(record.attrs))
    assert turned.attrs["direction"] == -found.attrs["direction"] == -1
    for name, scale in {"touch_time": 1.0, "restitution": 1.0, "incoming_speed": np.cos(0.35)}.items():
        np.testing.assert_allclose(turned[name], scale * found[name], rtol=1e-5)
    np.testing.assert_allclose(turned["touch_level"], 2e-3 - np.cos(0.35) * found["touch_level"], atol=1e-9)


def test_contact_hidden_in_a_gap_is_uncertain_by_the_gap(lossy):
    truth, record, found = lossy
    time = record["time"].values
    hidden = (time > truth.touch[0] - 5e-4) & (time < truth.liftoff[0] + 1e-3)
    gapped = record.copy(data=np.where(hidden, np.nan, record.values))
    with pytest.warns(UserWarning, match="impact 1: no valid readings from"):
        again = bounces(gapped)
    assert float(again.u_touch_time[0]) > 1e-3 > 20 * float(found.u_touch_time[0])
    for name, known in (("touch_time", truth.touch), ("liftoff_time", truth.liftoff)):
        assert abs(float(again[name][0]) - known[0]) < 3 * float(again[f"u_{name}"][0])
    restitution = truth.outgoing[0] / truth.incoming[0]
    assert abs(float(again.restitution[0]) - restitution) < 3 * float(again.u_restitution[0])
    np.testing.assert_allclose(again.touch_time[1:4], found.touch_time[1:4], atol=5e-5)


def test_record_that_starts_in_the_fall_is_extrapolated(bouncing, measure):
    truth = bouncing(**LOSSY)
    record = measure(truth, 20e3, 1e-6)[0].sel(time=slice(0.018, None))
    with pytest.warns(UserWarning, match="already falling"):
        found = bounces(record)
    assert float(found.release_time) == pytest.approx(truth.release, abs=3e-4)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (lambda t: 0 * t, "does not change"),
        (lambda t: 1e-3 * t, "no bounce"),
        (lambda t: 1e-3 * np.sin(100 * t) + 1e-6 * np.random.default_rng(0).random(t.size), "no "),
        (lambda t: -4.9 * t**2, "no bounce"),
        (lambda t: 1e-6 * np.random.default_rng(0).random(t.size), "no "),
    ],
    ids=["constant", "creep", "sinusoid", "free fall", "noise"],
)
def test_records_without_a_bounce_are_refused(displacement_of, shape, message):
    time = np.arange(4000) / 20e3
    with pytest.raises(InputError, match=message):
        bounces(displacement_of(time, shape(time)))


@pytest.mark.filterwarnings(STILL_MOVING)
@pytest.mark.parametrize("left", [9, 12])
def test_a_record_cut_in_its_second_contact_falls_as_before(displacement_of, left):
    # A spline bends by itself where a record ends; that was stronger than both contacts.
    rng, step = np.random.default_rng(1), 5e-5
    fall, rebound, contact = rng.uniform(1e-3, 4e-3), rng.uniform(0.5, 0.9), rng.uniform(3e-4, 8e-4)
    time = np.arange(0, 0.4, step)
    speed, begin = np.sqrt(2 * 9.81 * fall), 0.02
    touch, touches = begin + speed / 9.81, []
    height = np.where(time < begin, fall, fall - 0.5 * 9.81 * (time - begin) ** 2)
    for _ in range(4):
        touches.append(touch)
        inside = (time >= touch) & (time < touch + contact)
        pulse = CubicHermiteSpline([touch, touch + contact], [0, 0], [-speed, rebound * speed])
        height[inside] = pulse(time[inside])
        speed *= rebound
        flown = time - touch - contact
        height[flown >= 0] = (speed * flown - 0.5 * 9.81 * flown**2)[flown >= 0]
        touch += contact + 2 * speed / 9.81
    height += rng.normal(0, 1e-6, time.size)
    end = int(np.searchsorted(time, touches[1])) + left
    found = bounces(displacement_of(time[:end], height[:end]))
    assert found.sizes["impact"] == 1
    assert float(found.restitution[0]) == pytest.approx(rebound, abs=4 * float(found.u_restitution[0]))


@pytest.mark.filterwarnings(STILL_MOVING)
def test_an_elastic_body_returns_with_all_its_speed(bouncing, measure):
    truth = bouncing(loss=0.0, duration=0.2)
    z = []
    for seed in range(4):
        found = bounces(measure(truth, 50e3, 1e-6, seed, duration=0.2)[0]).isel(impact=slice(0, 3))
        np.testing.assert_allclose(found.restitution, 1.0, atol=3e-3)
        for name in ("touch", "liftoff"):
            z.append((found[f"{name}_time"] - getattr(truth, name)[:3]) / found[f"u_{name}_time"])
        z.append((found.incoming_speed - truth.incoming[:3]) / found.u_incoming_speed)
    assert np.sqrt(np.mean(np.square(z))) < 1.4


@pytest.mark.filterwarnings(STILL_MOVING)
def test_polymers_are_known_twice_as_well(displacement_of):
    # Truth from the package's own simulator, whose contact law these tests do not otherwise use.
    truth = drop(load("ptfe"), 9.525e-3, 0.505, 1.5e-3, 0.2)
    path = CubicHermiteSpline(*_strictly(truth["time"], truth["displacement"], truth["velocity"]))
    time = np.arange(0.0, 0.21, 5e-5)
    noise = 1e-6 * np.random.default_rng(3).standard_normal(len(time))
    record = displacement_of(time, path(np.maximum(time - 0.01, 0.0)) + noise)
    anything, polymer = bounces(record), bounces(record, contact="polymer")
    n = min(polymer.sizes["impact"], truth.sizes["impact"])
    for found in (anything, polymer):
        z_touch = (found.touch_time[:n] - 0.01 - truth.impact_time.values[:n]) / found.u_touch_time[:n]
        z = (found.restitution[:n] - truth.restitution.values[:n]) / found.u_restitution[:n]
        assert np.sqrt(np.mean(z_touch**2)) < 1.6
        assert np.sqrt(np.mean(z**2)) < 1.6
    assert float(polymer.u_restitution[0]) < 0.6 * float(anything.u_restitution[0])


@pytest.mark.filterwarnings(STILL_MOVING)
@pytest.mark.parametrize("rate", [2000, 2500])
def test_contacts_of_three_samples_are_no_longer_than_they_are(displacement_of, rate):
    """A film of few frames a second: the fit began with too long a contact and stayed there, 13 u off in height."""
    truth = drop(load("ptfe"), 9.525e-3, 0.505, 7e-3, 0.13)
    path = CubicHermiteSpline(*_strictly(truth["time"], truth["displacement"], truth["velocity"]))
    time, random = np.arange(round(0.138 * rate)) / rate, np.random.default_rng(7)
    for phase in (0.0, 0.25, 0.5, 0.75):
        since = np.maximum(time - 0.01 - phase / rate, 0.0)
        found = bounces(displacement_of(time, path(since) + 1.6e-7 * random.standard_normal(time.size)))
        assert abs(float(found.drop_height) - 7e-3) < 3.0 * float(found.u_drop_height) < 0.06e-3
        off = float(found.restitution[0]) - float(truth.restitution[0])
        assert abs(off) < 3.0 * float(found.u_restitution[0]) < 0.006


def _strictly(time, *columns):
    """Both sides of an event share one time: keep the first."""
    values, index = np.unique(time.values, return_index=True)
    return values, *(column.values[index] for column in columns)


def test_unknown_contact_laws_and_too_few_readings_are_refused(displacement_of):
    with pytest.raises(InputError, match='any, polymer; found "steel"'):
        bounces(displacement_of(np.arange(50.0), np.zeros(50)), contact="steel")
    with pytest.raises(InputError, match="at least 24 readings; found 10"):
        bounces(displacement_of(np.arange(10.0), np.zeros(10)).to_dataset(name="displacement"))
