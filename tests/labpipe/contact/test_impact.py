"""The drop against independent references: Ting's integral, Hertz, and trains of bounces."""

import json
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from labpipe.contact import Plate, drop
from labpipe.errors import InputError
from labpipe.materials import Prony
from tests.rounding import rounding

R, M, G, NU = 9.525e-3, 0.505, 9.81, 0.35
SLS = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=NU)
_TAU = np.logspace(-10, 2, 15)
_C = np.full(15, (1 / 2e9 - 1 / 6e9) / 15)
PMMA15 = Prony.from_creep(2e9, _C, _TAU, nu=NU)
# The four modes below 1e-7 s put into the instantaneous compliance: a material of its own.
PMMA11 = Prony.from_creep(2e9, _C[4:], _TAU[4:], nu=NU)

# Ting's integral, ten digits: e, F_max, delta_max, a_max, t_c
# Ting's integral without gravity, scaled units: E0, rho, e, F_max, delta_max, t_c
SCALED = [
    (0.0, 1.0, 0.236319011, 0.686561928, 1.305792728, 3.230946474),
    (0.0, 10.0, 0.867753478, 1.074639140, 1.111128224, 3.184772133),
    (0.0, 100.0, 0.985812406, 1.136041205, 1.095109836, 3.214306866),
    (0.0, 1000.0, 0.998570906, 1.142536690, 1.093536567, 3.217685134),
    (0.1, 1.0, 0.342073841, 0.733029313, 1.270957963, 3.374531842),
    (0.1, 10.0, 0.881421075, 1.081506970, 1.109270307, 3.189504590),
    (0.5, 0.1, 0.888301088, 0.817336991, 1.375703741, 4.187329810),
    (0.5, 1.0, 0.693615257, 0.920431315, 1.172785021, 3.417446749),
]
# Trains by a prototype with 1600 even springs and a step tolerance of 1e-10, by number of bounce:
# touch, t_c, v_in, e, F_max, a_max, delta_max
SLS_TRAIN = {
    1: (0.0, 1.115616e-3, 0.17155174, 0.72887820, 257.50634, 8.00166e-4, 6.721988e-5),
    2: (0.026442691, 1.203487e-3, 0.12341829, 0.71789195, 174.17621, 7.05549e-4, 5.226261e-5),
    3: (0.045524494, 1.309883e-3, 0.08678528, 0.70453813, 115.40150, 6.18225e-4, 4.012629e-5),
    5: (0.068560063, 1.637895e-3, 0.03816118, 0.65656622, 46.375808, 4.62386e-4, 2.244679e-5),
    6: (0.075008460, 1.973401e-3, 0.02213569, 0.58239721, 27.273076, 3.91531e-4, 1.609783e-5),
}


def fall_time(height):
    return float(np.sqrt(2 * height / G))


def first_impact(material, height, **options):
    return drop(material, R, M, height, fall_time(height) + 2e-3, **options)


def relative(result, name, expected, row=0):
    return abs(float(result[name][row]) / expected - 1.0)


def scaled_impact(E0, rho, **options):
    """m = v = 1 and (4/3) sqrt(R) = 1, with a sphere far larger than the contact."""
    material = Prony(E0, [1.0 - E0], [rho], nu=0.0) if rho else Prony(1.0, [], [], nu=0.0)
    gravity, mass = 1e-8, 4 / 3 * 10.0
    height = 0.5 / gravity
    fall = np.sqrt(2 * height / gravity)
    return drop(material, 100.0, mass, height, fall + 10.0, gravity=gravity, **options), mass


@pytest.fixture(scope="module")
def pmma_train():
    return drop(PMMA15, R, M, 0.0015, 0.5 + fall_time(0.0015))


@pytest.fixture(scope="module")
def sls_train():
    return drop(SLS, R, M, 0.0015, 0.5 + fall_time(0.0015), rtol=1e-5)


@pytest.mark.parametrize(("E0", "rho", "e", "F", "delta", "t_c"), SCALED)
@pytest.mark.parametrize("solver", ["mdr", "rings"])
def test_scaled_impacts_agree_with_ting(E0, rho, e, F, delta, t_c, solver):
    result, unit = scaled_impact(E0, rho, solver=solver)
    assert relative(result, "restitution", e) < 5e-5
    assert relative(result, "peak_force", F * unit) < 5e-5
    assert relative(result, "peak_approach", delta) < 5e-5
    assert relative(result, "contact_duration", t_c) < 5e-5


def test_sls_train_comes_to_rest_on_its_static_sag(sls_train):
    assert sls_train.sizes["impact"] == 6
    for number, (touch, _, v_in, e, F, a, delta) in SLS_TRAIN.items():
        row = number - 1
        assert float(sls_train.impact_time[row]) - fall_time(0.0015) == pytest.approx(touch, rel=1e-5, abs=1e-9)
        assert relative(sls_train, "impact_speed", v_in, row) < 3e-5
        assert relative(sls_train, "restitution", e, row) < 5e-5
        assert relative(sls_train, "peak_force", F, row) < 2e-5
        # The table's own radii are good to some 1e-4 in a train (compare its first with 3.7).
        assert relative(sls_train, "peak_contact_radius", a, row) < 2e-4
        assert relative(sls_train, "peak_approach", delta, row) < 2e-5
    assert float(sls_train.approach[-1]) == pytest.approx(6.534380e-6, rel=2e-6)
    assert float(sls_train.force[-1]) == pytest.approx(M * G, rel=1e-12)
    assert float(sls_train.rest_time) > float(sls_train.final_contact_time) > 0.09


def test_work_of_the_pmma_train_is_bounded(pmma_train):
    work = json.loads(pmma_train.attrs["work"])
    assert work["flights"] == 34
    assert work["terms"] + work["terms_folded"] + work["terms_frozen"] == 15
    assert work["solver_steps"] / 34 < 30
    assert work["kernel_products"] < 1.1 * work["solver_steps"]


def test_energy_ledger_closes_and_dissipation_only_grows(pmma_train, sls_train):
    for result in (pmma_train, sls_train):
        total = sum(
            result[name]
            for name in ("kinetic_energy", "potential_energy", "stored_energy", "dissipated_energy", "numerical_energy")
        )
        energy = M * G * 0.0015
        assert float(abs(total - energy).max()) < 1e-13 * energy
        assert result.attrs["energy_error"] < 1e-6
        assert float(abs(result.numerical_energy).max()) < 1e-4 * energy
        assert result.attrs["energy_error"] < 1e-4
        assert np.all(np.diff(result.dissipated_energy) >= 0.0)
        assert float(result.dissipated_energy[0]) == 0.0
        assert float(result.force.min()) >= 0.0


def test_signs_and_origin():
    result = first_impact(SLS, 0.0015)
    assert float(result.displacement[0]) == 0.0015
    assert float(result.time[0]) == 0.0
    assert float(result.velocity[0]) == 0.0
    touch = float(result.impact_time[0])
    assert touch == pytest.approx(fall_time(0.0015), rel=rounding(10))
    assert float(result.displacement.min()) == pytest.approx(-6.722e-5, rel=1e-3)
    assert float(result.velocity.min()) == pytest.approx(-0.1715, rel=1e-2)
    assert np.all(np.diff(result.time) > 0.0)
    for name in result.data_vars:
        assert "units" in result[name].attrs
        assert "long_name" in result[name].attrs


def test_asked_times_agree_with_the_steps():
    times = np.linspace(0.0, 0.12, 1201)
    asked = drop(SLS, R, M, 0.0015, 0.12, rtol=1e-5, times=times)
    fine = drop(SLS, R, M, 0.0015, 0.12, rtol=1e-7, times=times)
    in_contact = fine.force.values > 1.0
    for name, scale in (("displacement", 7e-5), ("velocity", 0.17), ("force", 257.0)):
        error = np.abs(asked[name].values - fine[name].values)[in_contact]
        assert error.max() < 3e-5 * scale
    nodes = drop(SLS, R, M, 0.0015, 0.12).time.values[::7]
    same = drop(SLS, R, M, 0.0015, 0.12)
    at_nodes = drop(SLS, R, M, 0.0015, 0.12, times=nodes)
    np.testing.assert_allclose(at_nodes.displacement, same.displacement[::7], atol=1e-16)
    np.testing.assert_allclose(at_nodes.force, same.force[::7], atol=1e-10)


def test_without_folding_the_answer_is_the_same():
    folded = first_impact(PMMA15, 0.0015)
    full = first_impact(PMMA15, 0.0015, fold=False)
    assert json.loads(full.attrs["work"])["terms"] == 15
    assert relative(full, "restitution", float(folded.restitution[0])) < 1e-6
    assert relative(full, "peak_force", float(folded.peak_force[0])) < 1e-6


def test_a_liquid_sinks_for_ever():
    maxwell = Prony(0.0, [2e9], [1e-3], nu=NU)
    result = drop(maxwell, R, M, 0.0005, 0.5)
    late = result.sel(time=slice(0.3, None))
    assert np.all(np.diff(late.displacement) < 0.0)
    # F J(t) law of an advancing contact: a^3 grows as the load times the creep
    cubes = late.contact_radius.values**3
    rate = np.diff(cubes[[0, -1]])[0] / float(late.time[-1] - late.time[0])
    expected = 0.75 * R * M * G * (1 - NU**2) * maxwell.fluidity
    assert rate == pytest.approx(expected, rel=3e-4)


def test_creep_at_rest_follows_the_compliance():
    result = drop(PMMA15, R, M, 1e-6, 50.0, times=[1.0, 10.0, 50.0])
    cubes = result.contact_radius.values**3
    expected = 0.75 * R * M * G * PMMA15.creep(result.time.values) * (1 - NU**2)
    np.testing.assert_allclose(cubes, expected, rtol=2e-3)
    np.testing.assert_allclose(result.force, M * G, rtol=1e-12)


def test_a_heavy_stiff_plate_is_rigid_and_a_light_one_takes_energy():
    rigid = first_impact(SLS, 0.0015)
    heavy = first_impact(SLS, 0.0015, plate=Plate(1e7, 50.0, 0.01))
    light = first_impact(SLS, 0.0015, plate=Plate(5.0, 200.0, 0.01))
    assert relative(heavy, "restitution", float(rigid.restitution[0])) < 1e-5
    assert float(light.restitution[0]) < 0.95 * float(rigid.restitution[0])
    assert float(light.rigid_restitution) == pytest.approx(float(rigid.restitution[0]))
    total = sum(light[name] for name in light.data_vars if name.endswith("_energy"))
    assert float(abs(total - M * G * 0.0015).max()) < 1e-12 * M * G * 0.0015
    assert light.attrs["energy_error"] < 1e-6


def test_bounces_on_a_ringing_plate_are_followed():
    result = drop(PMMA15, R, M, 0.0015, 0.1, plate=Plate(20.0, 400.0, 0.02), times=None)
    assert result.sizes["impact"] >= 2
    assert np.all(np.diff(result.time) > 0.0)
    assert float(result.force.min()) >= 0.0
    touching = np.abs(result.force.values) > 0
    assert touching.any()
    free = result.approach.values[~touching]
    assert free.max() < 1e-5


def test_progress_is_reported():
    seen = []
    drop(SLS, R, M, 0.0015, 0.05, progress=seen.append)
    assert seen == sorted(seen)
    assert 0.0 < seen[0] < seen[-1] <= 1.0


def test_the_contact_may_outgrow_its_springs():
    """A soft solid under a heavy holder creeps far beyond the first estimate."""
    soft = Prony.from_creep(1e6, np.full(7, 0.999e-6 / 7), np.logspace(-4, 2, 7), nu=0.45)
    result = drop(soft, R, 0.01, 1e-4, 200.0)
    expected = (0.75 * R * 0.01 * G * float(soft.creep(200.0)) * (1 - 0.45**2)) ** (1 / 3)
    assert float(result.contact_radius[-1]) == pytest.approx(expected, rel=3e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radius": 0.0}, "radius"),
        ({"mass": -1.0}, "mass"),
        ({"height": -1e-3}, "height"),
        ({"height": np.nan}, "height"),
        ({"duration": np.inf}, "duration"),
        ({"gravity": 0.0}, "gravity"),
        ({"solver": "fem"}, "mdr, rings, thesis"),
        ({"profile": "cone"}, "parabola, sphere"),
        ({"rtol": 1e-12}, "rtol"),
        ({"rtol": 0.5}, "rtol"),
        ({"times": [0.0, 0.0]}, "increase"),
        ({"times": [0.0, 99.0]}, "within"),
        ({"times": []}, "increase"),
        ({"radius": "9.525 ± 0.005 mm"}, "states an uncertainty"),
        ({"radius": -0.009000000000000001}, "radius is -0.009 m,"),
        ({"diameter": "19.05 mm"}, 'give radius="9.525 mm"'),
        ({"mass": None}, "drop needs mass"),
        ({"substrate": "diamond"}, "diamond"),
        ({"substrate": (-1.0, 0.3)}, "positive modulus"),
        ({"ring_width": -1.0, "solver": "rings"}, "ring_width"),
        ({"solver": "thesis", "plate": Plate(1.0, 100.0)}, "rigid"),
        ({"max_steps": 20}, "max_steps"),
    ],
)
def test_bad_input_is_refused_with_the_reason(change, message):
    arguments = {"radius": R, "mass": M, "height": 0.0015, "duration": 0.05} | change
    with pytest.raises(InputError, match=message):
        drop(SLS, **arguments)


def test_a_contact_wider_than_the_sphere_is_refused():
    with pytest.raises(InputError, match="wider than the sphere"):
        drop(Prony(1e3, [], [], nu=NU), R, M, 0.0015, 0.1)


def test_an_elastic_sphere_that_never_stops_is_refused_at_once():
    with pytest.raises(InputError, match="elastic sphere never stops"):
        drop(Prony(2e9, [], [], nu=NU), R, M, 1e-9, 100.0)


def test_a_duration_shorter_than_the_fall_is_a_fall():
    result = drop(SLS, R, M, 0.0015, 0.01)
    assert result.sizes["impact"] == 0
    assert float(result.force.max()) == 0.0
    assert float(result.displacement[-1]) == pytest.approx(0.0015 - 0.5 * G * 1e-4, rel=1e-12)


def _weights(count):
    return st.lists(st.floats(0.01, 1.0), min_size=count, max_size=count)


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    log_modulus=st.floats(6, 12),
    log_ratio=st.floats(0.05, 4),
    weights=st.integers(1, 6).flatmap(_weights),
    log_tau=st.floats(-9, 1),
    log_mass=st.floats(-6, 3),
    log_height=st.floats(-9, 0),
    nu=st.floats(0, 0.4999),
)
def test_any_drop_is_right_or_refused(log_modulus, log_ratio, weights, log_tau, log_mass, log_height, nu):
    """Energy bounds the error; nothing is negative, nothing hangs."""
    relaxed, mass, height = 10**log_modulus, 10**log_mass, 10**log_height
    share = np.array(weights) / np.sum(weights)
    C = share / relaxed * (1 - 10**-log_ratio)
    tau = 10 ** (log_tau + np.arange(len(weights)))
    material = Prony.from_creep(relaxed, C, tau, nu=nu)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            result = drop(material, 0.05, mass, height, 1.5 * fall_time(height), max_steps=4000)
        except InputError:
            return
    assert result.attrs["energy_error"] < 5e-4 or caught
    assert np.all(np.diff(result.dissipated_energy) >= 0.0)
    assert float(result.force.min()) >= 0.0
    assert np.all(np.isfinite(result.displacement))
    # What the energies miss by is what a rebound may have too much.
    assert np.all(result.restitution < 1.0 + result.attrs["energy_error"])


@pytest.mark.parametrize("plate", [None, Plate(mass=5.0, frequency=200.0, damping_ratio=0.02)])
def test_the_reduced_gap_is_closed_in_contact_and_counts_the_dent_in_flight(plate):
    found = {s: drop(SLS, R, M, 1.5e-3, 0.06, solver=s, plate=plate) for s in ("mdr", "rings")}
    dents = {}
    for solver, made in found.items():
        gap, loaded = made.reduced_gap.values, made.force.values > 0
        assert np.all(gap[loaded] == 0.0)
        assert gap.min() > -1e-9
        after = float(made.lift_off_time[0]) + np.array([1e-4, 1e-3, 5e-3])
        asked = drop(SLS, R, M, 1.5e-3, 0.06, solver=solver, plate=plate, times=after)
        dents[solver] = (asked.reduced_gap + asked.approach).values
    # What is left 0.1 ms after lift-off recovers with the material's one retardation time.
    np.testing.assert_allclose(dents["mdr"][0] / dents["mdr"][1], np.exp(0.9), rtol=0.01)
    np.testing.assert_allclose(dents["rings"], dents["mdr"], rtol=2e-3)
