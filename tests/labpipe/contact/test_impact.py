"""The drop against independent references: Ting's integral, Hertz, and trains of bounces."""

import json

import numpy as np
import pytest

from labpipe.contact import Plate, drop, impacts
from labpipe.errors import InputError
from labpipe.materials import Prony, load
from tests.rounding import rounding

R, M, G, NU = 9.525e-3, 0.505, 9.81, 0.35
SLS = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=NU)
PMMA15 = Prony.from_creep(2e9, np.full(15, (1 / 2e9 - 1 / 6e9) / 15), np.logspace(-10, 2, 15), nu=NU)

# Ting's integral without gravity, scaled units: E0, rho, e, F_max, delta_max, t_c
SCALED = [
    (0.0, 1.0, 0.236319011, 0.686561928, 1.305792728, 3.230946474),
    (0.0, 1000.0, 0.998570906, 1.142536690, 1.093536567, 3.217685134),
    (0.1, 10.0, 0.881421075, 1.081506970, 1.109270307, 3.189504590),
    (0.5, 1.0, 0.693615257, 0.920431315, 1.172785021, 3.417446749),
]


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


@pytest.mark.parametrize(("E0", "rho", "e", "F", "delta", "t_c"), SCALED)
@pytest.mark.parametrize("solver", ["mdr", "rings"])
def test_scaled_impacts_agree_with_ting(E0, rho, e, F, delta, t_c, solver):
    result, unit = scaled_impact(E0, rho, solver=solver)
    assert relative(result, "restitution", e) < 5e-5
    assert relative(result, "peak_force", F * unit) < 5e-5
    assert relative(result, "peak_approach", delta) < 5e-5
    assert relative(result, "contact_duration", t_c) < 5e-5


def test_work_of_the_pmma_train_is_bounded(pmma_train):
    work = json.loads(pmma_train.attrs["work"])
    assert work["flights"] == 34
    assert work["terms"] + work["terms_folded"] + work["terms_frozen"] == 15
    assert work["solver_steps"] / 34 < 30
    assert work["kernel_products"] < 1.1 * work["solver_steps"]


def test_energy_ledger_closes_and_dissipation_only_grows(pmma_train):
    sls_train = drop(SLS, R, M, 0.0015, 0.5 + fall_time(0.0015), rtol=1e-5)
    energy = M * G * 0.0015
    for result in (pmma_train, sls_train):
        total = sum(result[name] for name in result.data_vars if name.endswith("_energy"))
        assert float(abs(total - energy).max()) < 1e-13 * energy
        assert result.attrs["energy_error"] < 1e-6
        assert float(abs(result.numerical_energy).max()) < 1e-4 * energy
        assert np.all(np.diff(result.dissipated_energy) >= 0.0)
        assert float(result.dissipated_energy[0]) == 0.0
        assert float(result.force.min()) >= 0.0


def test_signs_and_origin():
    result = first_impact(SLS, 0.0015)
    assert [float(result[name][0]) for name in ("time", "displacement", "velocity")] == [0.0, 0.0015, 0.0]
    assert float(result.impact_time[0]) == pytest.approx(fall_time(0.0015), rel=rounding(10))
    assert float(result.displacement.min()) == pytest.approx(-6.722e-5, rel=1e-3)
    assert float(result.velocity.min()) == pytest.approx(-0.1715, rel=1e-2)
    assert np.all(np.diff(result.time) > 0.0)


def test_asked_times_agree_with_the_steps():
    times = np.linspace(0.0, 0.12, 1201)
    asked = drop(SLS, R, M, 0.0015, 0.12, rtol=1e-5, times=times)
    fine = drop(SLS, R, M, 0.0015, 0.12, rtol=1e-7, times=times)
    in_contact = fine.force.values > 1.0
    for name, scale in (("displacement", 7e-5), ("velocity", 0.17), ("force", 257.0)):
        error = np.abs(asked[name].values - fine[name].values)[in_contact]
        assert error.max() < 3e-5 * scale
    same = drop(SLS, R, M, 0.0015, 0.12)
    at_nodes = drop(SLS, R, M, 0.0015, 0.12, times=same.time.values[::7])
    np.testing.assert_allclose(at_nodes.displacement, same.displacement[::7], atol=1e-16)
    np.testing.assert_allclose(at_nodes.force, same.force[::7], atol=1e-10)


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
        ({"duration": np.inf}, "duration"),
        ({"solver": "fem"}, "mdr, rings, thesis"),
        ({"profile": "cone"}, "parabola, sphere"),
        ({"rtol": 1e-12}, "rtol"),
        ({"times": [0.0, 0.0]}, "increase"),
        ({"times": [0.0, 99.0]}, "within"),
        ({"radius": "9.525 ± 0.005 mm"}, "states an uncertainty"),
        ({"diameter": "19.05 mm"}, 'give radius="9.525 mm"'),
        ({"mass": None}, "drop needs mass"),
        ({"substrate": "diamond"}, "diamond"),
        ({"ring_width": -1.0, "solver": "rings"}, "ring_width"),
        ({"solver": "thesis", "plate": Plate(1.0, 100.0)}, "rigid"),
        ({"max_steps": 20}, "max_steps"),
        ({"material": Prony(1e3, [], [], nu=NU)}, "wider than the sphere"),
        ({"material": Prony(1e9, [], [], viscosity=1e6)}, "instantaneous"),
        ({"material": Prony(2e9, [], [], nu=NU), "height": 1e-9, "duration": 100.0}, "elastic sphere never stops"),
    ],
)
def test_bad_input_is_refused_with_the_reason(change, message):
    arguments = {"material": SLS, "radius": R, "mass": M, "height": 0.0015, "duration": 0.05} | change
    with pytest.raises(InputError, match=message):
        drop(**arguments)


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


@pytest.mark.parametrize(
    ("mass", "frequency", "damping_ratio"),
    [(0.0, 1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 1.0), (1.0, 1.0, -0.1), (np.nan, 1.0, 0.0)],
)
def test_impossible_plates_are_refused(mass, frequency, damping_ratio):
    with pytest.raises(InputError, match="plate"):
        Plate(mass, frequency, damping_ratio)


def test_penetration_is_of_the_sphere_where_the_plate_gives_way() -> None:
    """The plate is pushed ahead: the sphere sinks deeper than both approach each other."""
    case = {"radius": 9.525e-3, "mass": 0.505, "height": 5e-3, "duration": 0.05, "plate": Plate(25.0, 220.0, 0.03)}
    solid = Prony(3.0e9, [2e8], [1e-3], nu=0.35)
    plain = drop(solid, **case)
    touch, lasts = float(plain.impact_time[0]), float(plain.contact_duration[0])
    seen = drop(solid, **case, times=np.linspace(touch, touch + lasts, 4001))
    assert float(plain.penetration[0]) == pytest.approx(-float(seen.displacement.min()), rel=1e-6)
    assert float(impacts(solid, **case).penetration[0, 0]) == pytest.approx(float(plain.penetration[0]), rel=1e-4)
    assert float(plain.penetration[0]) > 1.005 * float(plain.peak_approach[0])


@pytest.mark.parametrize(("a_T", "b_T"), [(0.1363, 1.0), (0.5, 0.8)])
def test_a_shifted_impact_is_the_same_impact_on_another_scale(a_T: float, b_T: float) -> None:
    """Lengths and times times a_T, moduli b_T: forces a_T² b_T, mass a_T³ b_T, gravity 1/a_T, at the same speed."""
    solid = load("acrylic")
    here = drop(solid, R, M, 1.5e-3, 0.08, gravity=G)
    there = drop(solid.shifted(a_T, b_T), a_T * R, a_T**3 * b_T * M, a_T * 1.5e-3, a_T * 0.08, gravity=G / a_T)
    assert here.sizes["impact"] == there.sizes["impact"] == 2
    scales = {
        "restitution": 1.0,
        "impact_speed": 1.0,
        "impact_time": a_T,
        "contact_duration": a_T,
        "peak_approach": a_T,
        "peak_contact_radius": a_T,
        "peak_force": a_T**2 * b_T,
        "energy_dissipated": a_T**3 * b_T,
    }
    for name, scale in scales.items():
        np.testing.assert_allclose(there[name], scale * here[name], rtol=1e-11, err_msg=name)
