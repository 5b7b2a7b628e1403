"""The accuracy of every contact solver, against closed forms and integrations that share nothing with it."""

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from labpipe import contact
from labpipe.contact.impact import disc_displacement
from labpipe.contact.line import line_kernel, westergaard
from labpipe.errors import InputError
from labpipe.materials import Prony

RADIUS, MASS, GRAVITY, NU = 9.525e-3, 0.505, 9.81, 0.35
SLS = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=NU)
PMMA = Prony.from_creep(2e9, np.full(15, (1 / 2e9 - 1 / 6e9) / 15), np.logspace(-10, 2, 15), nu=NU)

# Ting's solution with gravity, ten digits (DOP853): height, e, F_max, delta_max, a_max, contact time.
TING = [
    (1.5e-3, 0.7288782966, 257.5063769, 6.721988329e-5, 8.001683500e-4, 1.115611844e-3),
    (5.0e-3, 0.7470918873, 530.9392778, 1.072505593e-4, 1.010723294e-3, 9.765980559e-4),
]
# Whole trains from 1.5 mm, 1600 springs at a tolerance of 1e-10: impact, touch, e, F_max, a_max, delta_max.
TRAINS = {
    "sls": (SLS, 6, [
        (2, 0.026442691, 0.71789195, 174.17621, 7.05549e-4, 5.226261e-5),
        (3, 0.045524494, 0.70453813, 115.40150, 6.18225e-4, 4.012629e-5),
        (5, 0.068560063, 0.65656622, 46.375808, 4.62386e-4, 2.244679e-5),
        (6, 0.075008460, 0.58239721, 27.273076, 3.91531e-4, 1.609783e-5),
    ]),
    "pmma": (PMMA, 34, [
        (1, 0.0, 0.938866, 259.514693, 8.30597e-4, 7.243673e-5),
        (2, 0.034046427, 0.938783, 240.709239, 8.10348e-4, 6.894405e-5),
        (3, 0.066052398, 0.938675, 223.234283, 7.90465e-4, 6.560317e-5),
        (32, 0.484611580, 0.90733, 22.415490, 3.72224e-4, 1.463209e-5),
    ]),
}  # fmt: skip
# Triangle of approach t, 2 - t on E(t) = 0.1 + 0.9 exp(-t): F in units of 4/3 sqrt(R), a^2/R.
TRIANGLE = {
    0.25: (0.11451088227227, 0.25),
    1.0: (0.72359266566776, 1.0),
    1.2: (0.35263839545418, 0.75717533691364),
    1.4: (0.092806179861841, 0.38948330058915),
}


def elastic_impact(modulus: float, height: float) -> tuple[float, float]:
    """Duration and peak force of m z'' = m g - k z^(3/2), integrated to 1e-12."""
    k = 4 / 3 * modulus * np.sqrt(RADIUS)
    ends = lambda _, y: y[0] if y[1] < 0 else 1.0  # noqa: E731
    ends.terminal = True
    turns = lambda _, y: y[1]  # noqa: E731
    run = solve_ivp(
        lambda _, y: [y[1], GRAVITY - k / MASS * max(y[0], 0.0) ** 1.5],
        (0.0, 0.1), [0.0, np.sqrt(2 * GRAVITY * height)], "DOP853", events=(ends, turns), rtol=1e-12, atol=1e-18,
    )  # fmt: skip
    return float(run.t_events[0][0]), k * float(run.y_events[1][0][0]) ** 1.5


def test_an_elastic_impact_is_that_of_hertz() -> None:
    steel = Prony(3.2e9, [], [], nu=NU)
    duration, force = elastic_impact(3.2e9 / (1 - NU**2), 1.5e-3)
    found = contact.drop(steel, RADIUS, MASS, 1.5e-3, 0.03, rtol=1e-7)
    assert float(found.contact_duration[0]) == pytest.approx(duration, rel=1e-8)
    assert float(found.peak_force[0]) == pytest.approx(force, rel=1e-8)
    assert float(found.restitution[0]) == pytest.approx(1.0, abs=1e-7)
    modulus = 3.2e9 / (1 - NU**2)
    pressure = np.cbrt(6 * force * modulus**2 / (np.pi**3 * RADIUS**2))
    assert float(found.peak_pressure[0]) == pytest.approx(pressure, rel=1e-7)


@pytest.mark.parametrize(("rtol", "bound"), [(1e-4, 1e-5), (1e-7, 2e-8)])
@pytest.mark.parametrize("row", TING, ids=["1.5 mm", "5 mm"])
def test_a_first_impact_is_that_of_ting(row, rtol, bound) -> None:
    height, e, force, approach, radius, duration = row
    found = contact.drop(SLS, RADIUS, MASS, height, 0.05, rtol=rtol).isel(impact=0)
    assert float(found.restitution) == pytest.approx(e, rel=bound)
    assert float(found.peak_force) == pytest.approx(force, rel=bound)
    assert float(found.peak_approach) == pytest.approx(approach, rel=bound)
    assert float(found.peak_contact_radius) == pytest.approx(radius, rel=bound)
    assert float(found.contact_duration) == pytest.approx(duration, rel=max(bound, 1e-7))


@pytest.mark.parametrize("name", TRAINS)
def test_a_train_of_bounces(name) -> None:
    """Touch times, restitutions and peaks down to the last bounces, at the default tolerance."""
    material, count, rows = TRAINS[name]
    fall = np.sqrt(2 * 1.5e-3 / GRAVITY)
    found = contact.drop(material, RADIUS, MASS, 1.5e-3, 0.5 + fall)
    assert found.sizes["impact"] == count
    for number, touch, e, force, radius, approach in rows:
        one = found.isel(impact=number - 1)
        late = 1.0 + 0.25 * number  # errors of the speed add up
        assert float(one.impact_time) - fall == pytest.approx(touch, rel=5e-5, abs=1e-12)
        assert float(one.restitution) == pytest.approx(e, rel=2e-5 * late)
        assert float(one.peak_force) == pytest.approx(force, rel=3e-5 * late)
        assert float(one.peak_contact_radius) == pytest.approx(radius, rel=1e-4)
        assert float(one.peak_approach) == pytest.approx(approach, rel=2e-5 * late)


def test_a_sphere_comes_to_rest_where_it_would_be_put_down() -> None:
    found = contact.drop(SLS, RADIUS, MASS, 1.5e-3, 0.5)
    assert float(found.approach[-1]) == pytest.approx(6.534380e-6, rel=1e-5)
    assert float(found.force[-1]) == pytest.approx(MASS * GRAVITY, rel=1e-4)
    assert float(found.rest_time) < 0.2


@pytest.mark.parametrize("solver", ["rings", "thesis"])
def test_boundary_elements_agree_with_the_springs(solver) -> None:
    """Equations (3.4)-(3.9) reach the same impact as Ting's solution, each as finely as it is asked to."""
    finer = {"time_step": 2e-6} if solver == "thesis" else {}
    found = contact.drop(SLS, RADIUS, MASS, 1.5e-3, 0.0205, solver=solver, **finer)
    bounds = (3e-5, 3e-5, 3e-4) if solver == "rings" else (1e-3, 1e-3, 3e-2)
    for name, exact, bound in zip(("restitution", "peak_force", "peak_contact_radius"),
                                  (TING[0][1], TING[0][2], TING[0][4]), bounds, strict=True):  # fmt: skip
        assert float(found[name][0]) == pytest.approx(exact, rel=bound)


@pytest.mark.parametrize("r", [0.2, 0.7, 0.99, 1.01, 2.5])
def test_the_ring_kernel_is_boussinesq_integrated_in_polar_coordinates(r) -> None:
    """Equation (3.5), by trapezoids over an angle in which the integrand is smooth and periodic."""
    angle = np.linspace(0.0, np.pi, 20001)[:-1]
    if r < 1.0:
        exact = 2.0 * np.mean(np.sqrt(1.0 - (r * np.sin(angle)) ** 2))
    else:
        exact = 2.0 * np.mean(np.cos(angle) ** 2 / np.sqrt(1.0 - (np.sin(angle) / r) ** 2)) / r
    assert float(disc_displacement(r, 1.0)) == pytest.approx(exact, rel=2e-14)


def test_the_periodic_green_function_is_its_fourier_sum() -> None:
    """Equation (2.12), 4e5 terms of 2/|q|."""
    period, n = 8e-3, 64
    kernel = line_kernel(period, n)
    m = np.arange(1, 400_001)
    for strip in (0, 1, 7, 32):
        terms = np.sinc(m / n) * np.cos(2 * np.pi * m * strip / n) / m
        assert kernel.influence[strip] == pytest.approx(period / n * 2 / np.pi * terms[::-1].sum(), rel=2e-8, abs=1e-14)


@pytest.mark.parametrize("nu", [0.0, 0.35, 0.49])
@pytest.mark.parametrize("thickness", [1e-3, 4e-3])
def test_a_bonded_layer_is_plane_strain_elasticity(thickness, nu) -> None:
    """Airy's stress function with four constants for each wave number."""
    period, n = 8e-3, 64
    change = line_kernel(period, n, thickness, nu).influence - line_kernel(period, n).influence
    strip = np.arange(n)
    exact = np.full(n, thickness * (1 + nu) * (1 - 2 * nu) / (1 - nu) / (1 - nu**2) / n)
    for m in range(1, int(20 * period / (2 * np.pi * thickness)) + 1):
        z = 2 * np.pi * m * thickness / period  # depth times wave number, which is 1 below

        def derivatives(z: float, depth: float) -> np.ndarray:
            """Rows f, f', f'', f''' of exp(-z), z exp(-z), exp(z - H), z exp(z - H)."""
            low, high = np.exp(-z), np.exp(z - depth)
            return np.array([
                [low, z * low, high, z * high],
                [-low, (1 - z) * low, high, (1 + z) * high],
                [low, (z - 2) * low, high, (2 + z) * high],
                [-low, (3 - z) * low, high, (3 + z) * high],
            ])  # fmt: skip

        top, base = derivatives(0.0, z), derivatives(z, z)
        system = [top[0], top[1], (1 - nu) * base[2] + nu * base[0], (2 - nu) * base[1] - (1 - nu) * base[3]]
        constants = np.linalg.solve(np.array(system), [1.0, 0.0, 0.0, 0.0])
        factor = 0.5 * float(top[3] @ constants) - 1.0
        wave = 2 * np.pi * m / period
        exact += 2 / n * np.sinc(m / n) * 2 / wave * factor * np.cos(2 * np.pi * m * strip / n)
    assert change == pytest.approx(exact, abs=2e-7 * np.abs(change).max())


def test_a_narrow_line_contact_is_that_of_hertz() -> None:
    tip, modulus = 2e-3, 1e9
    found = contact.indent(Prony(modulus, [], [], nu=0.0), tip, 200 * tip, 1.0, [0.0], [2e-4], elements=60_000)
    assert float(found.contact_half_width[0]) == pytest.approx(
        np.sqrt(4 * float(found.force[0]) * tip / (np.pi * modulus)), rel=4e-4
    )


@pytest.mark.parametrize("approach", [0.1e-3, 0.2e-3, 0.3e-3])
def test_a_cosine_is_that_of_westergaard(approach) -> None:
    """Equations (2.17)-(2.22): delta = h s^2 (1 - ln s^2), F = pi E* h s^2."""
    tip, period, modulus, depth = 2e-3, 8e-3, 10.14e6, 18e-3
    h = period**2 / (4 * np.pi**2 * tip)
    square = brentq(lambda s: h * s * (1 - np.log(s)) - approach, 1e-9, 1.0, xtol=1e-16)
    force = np.pi * modulus * h * square
    closed = westergaard.from_displacement(approach, tip, period, modulus, "cosine")
    assert float(closed.force) == pytest.approx(force, rel=1e-12)
    assert float(closed.half_width) == pytest.approx(period / np.pi * np.arcsin(np.sqrt(square)), rel=1e-11)
    found = contact.indent(Prony(modulus, [], [], nu=0.0), tip, period, depth, [0.0], [approach], profile="cosine")
    assert float(found.force[0]) == pytest.approx(force * depth, rel=2e-6)


def test_small_oscillations_dissipate_what_the_complex_modulus_says() -> None:
    """Equations (2.31) and (2.34), direct, and the area of the simulated loop."""
    rubber, tip, period, depth = Prony(7.6e6, [30e6, 60e6], [1e-2, 1e-4], nu=0.5), 2e-3, 8e-3, 18e-3
    frequency, amplitude, mean = 20.0, 2e-7, 1e-4
    h, omega = period**2 / (4 * np.pi**2 * tip), 2 * np.pi * 20.0
    square = brentq(lambda s: h * s * (1 - np.log(s)) - mean, 1e-9, 1.0, xtol=1e-16)
    modulus = 7.6e6 + sum(E * 1j * omega * rho / (1 + 1j * omega * rho) for E, rho in ((30e6, 1e-2), (60e6, 1e-4)))
    work = np.pi * depth * np.pi * modulus.imag / 0.75 / -np.log(square) * amplitude**2
    geometry = (mean, tip, period)
    assert float(contact.dissipated_work(rubber, frequency, amplitude, *geometry, depth)) == pytest.approx(
        work, rel=1e-11
    )
    front = 7.6e6 * (mean - h * square) / abs(modulus)
    assert float(contact.tapping_amplitude(rubber, frequency, *geometry)) == pytest.approx(front, rel=1e-11)
    since = np.linspace(0.0, 3.0, 1201)[1:] / frequency
    time = np.concatenate([[0.0, 1.0], 1.0 + since])
    pressed = np.concatenate([[0.0, mean], mean + amplitude * np.sin(omega * since)])
    found = contact.indent(rubber, tip, period, depth, time, pressed, profile="cosine")
    loop = np.trapezoid(found.force.values[-401:], found.displacement.values[-401:])
    assert loop == pytest.approx(work, rel=2e-3)


def test_a_triangle_of_approach_is_that_of_ting() -> None:
    body = Prony(0.1, [0.9], [1.0], nu=0.0)
    time = np.linspace(0.0, 2.0, 2001)
    depth = np.where(time <= 1.0, time, 2.0 - time)
    found = contact.press_sphere(body, 1.0, time, depth)
    for instant, (force, square) in TRIANGLE.items():
        row = round(1000 * instant)
        assert float(found.force[row]) / (4 / 3) == pytest.approx(force, abs=1e-7)
        assert float(found.contact_radius[row]) ** 2 == pytest.approx(square, abs=2e-5)


def test_creep_under_two_loads_is_that_of_lee_and_radok() -> None:
    """a^3 = (3/4) R int J*(t - s) dF while the contact grows."""
    time, load = np.array([0.0, 60.0, 60.0, 3600.0]), np.array([4.954, 4.954, 24.77, 24.77])
    creep = lambda t: PMMA.creep(t) * (1 - NU**2)  # noqa: E731
    cube = 0.75 * RADIUS * (4.954 * creep(time) + 19.816 * creep(np.maximum(time - 60.0, 0.0)) * [0, 0, 1, 1])
    found = contact.load_sphere(PMMA, RADIUS, time, load)
    assert found.approach.values == pytest.approx(np.cbrt(cube) ** 2 / RADIUS, rel=1e-6)
    assert found.contact_radius.values == pytest.approx(np.cbrt(cube), rel=1e-5)


@pytest.mark.parametrize("damping", [0.0, 2e3, 15e3])
def test_a_collision_of_appendix_a_integrated_by_another_integrator(damping) -> None:
    """(A.6) with the dashpot against the motion; the force never pulls."""
    k = 4 * 3.2e9 * np.sqrt(RADIUS) / (3 * (1 - NU**2))
    force = lambda y: k * max(y[0], 0.0) ** 1.5 + damping * np.sqrt(max(y[0], 0.0)) * y[1]  # noqa: E731
    ends = lambda _, y: k * y[0] + damping * y[1] if y[1] < 0 else 1.0  # noqa: E731
    ends.terminal = True
    start = [1e-30, np.sqrt(2 * GRAVITY * 1.5e-3)]
    run = solve_ivp(lambda _, y: [y[1], GRAVITY - force(y) / MASS], (0.0, 0.1), start, "DOP853",
                    events=ends, rtol=1e-13, atol=1e-18)  # fmt: skip
    found = contact.collision(RADIUS, MASS, 1.5e-3, damping=damping, duration=0.03)
    assert float(found.restitution[0]) == pytest.approx(-float(run.y_events[0][0][1]) / start[1], rel=1e-8)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(20))
def test_random_drops_are_right_or_refused(seed) -> None:
    """A hundred of two thousand: every drop obeys the laws of mechanics, or is refused in a sentence."""
    rng = np.random.default_rng(seed)
    for _ in range(100):
        n = int(rng.integers(0, 12))
        E = 10 ** rng.uniform(5, 11)
        total = E * 10 ** rng.uniform(-2, 3)
        weights = rng.dirichlet(np.ones(n)) * total if n else []
        material = Prony(E, weights, 10 ** rng.uniform(-9, 3, n), nu=rng.uniform(0.0, 0.499))
        radius, mass = 10 ** rng.uniform(-3.5, -1), 10 ** rng.uniform(-4, 1)
        height = 10 ** rng.uniform(-5, 0)
        plate = None
        if rng.random() < 0.4:
            plate = contact.Plate(10 ** rng.uniform(-1, 2), 10 ** rng.uniform(1, 3.5), rng.uniform(0.0, 0.2))
        try:
            found = contact.drop(material, radius, mass, height, 0.2 + 2 * np.sqrt(2 * height / 9.81), plate=plate)
        except InputError:
            continue
        assert json.loads(found.attrs["work"])["spring_updates"] < 1e10
        assert np.all(np.isfinite(found.displacement.values))
        assert np.all(found.force.values >= 0.0)
        assert float(found.attrs["energy_error"]) < 5e-4
        if plate is None:
            assert np.all(found.restitution.values <= 1.0 + 1e-5)
