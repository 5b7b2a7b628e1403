"""The stepper of one contact: what it guards, and how its work counts."""

import json

import numpy as np
import pytest

from labpipe.contact import Shortcuts, drop
from labpipe.contact.impact._bounce import Stepper
from labpipe.contact.impact._line_springs import line_springs
from labpipe.contact.impact._motion import Body
from labpipe.contact.impact._plate import Plate
from labpipe.contact.impact._rest import RestTest
from labpipe.contact.memory._creep import Creep
from labpipe.errors import LabpipeError
from labpipe.materials import Prony

R, MASS, GRAVITY, SPEED = 0.01, 0.5, 9.81, 0.2


def stepper(creep, memory=None, plate=None):
    springs = line_springs(R, 2e-3, 1e-4, 60)
    result = Stepper(
        creep=creep,
        springs=springs,
        body=Body(MASS, GRAVITY, plate),
        tolerance=1e-7,
        time_scale=1e-3,
        speed_scale=SPEED,
        largest_radius=R,
        expected_radius=1e-3,
        max_steps=100_000,
    )
    result.velocity, result.acceleration = SPEED, GRAVITY
    if memory is not None:
        result.memory[:] = memory(springs.position)
    return result


NEVER_RESTS = RestTest(0.0, 1.0, 1.0)


def test_lift_off_ends_with_no_force_at_the_centre():
    creep = Creep.from_terms(0.3e-9, [0.2e-9], [1e-3])
    body = stepper(creep)
    body.touch(1e-3)
    assert body.run(1.0, NEVER_RESTS) == "lift-off"
    assert body.force == 0.0
    # The sphere leaves exactly where the central spring has recovered to.
    assert body.approach == pytest.approx(float(body.memory[:, 0].sum()), rel=1e-13, abs=0.0)
    assert body.velocity < 0.0


def test_a_contact_beyond_the_block_takes_more_springs_and_changes_nothing():
    creep = Creep.from_terms(0.3e-9, [0.2e-9], [1e-3])
    small, large = stepper(creep), stepper(creep)
    small.touch(1e-4)
    large.touch(1.5e-3)
    small.run(1.0, NEVER_RESTS)
    large.run(1.0, NEVER_RESTS)
    assert small.velocity == pytest.approx(large.velocity, rel=1e-10)
    assert small.time == pytest.approx(large.time, rel=1e-10)
    np.testing.assert_allclose(small.memory, large.memory, rtol=1e-8, atol=1e-20)


def test_a_surface_that_would_touch_in_a_ring_is_refused():
    """A dent that is deeper at the centre than the sphere is curved cannot be one disc."""
    creep = Creep.from_terms(0.3e-9, [0.2e-9], [1e3])
    body = stepper(creep, lambda x: 3e-5 * np.exp(-((x / 1e-4) ** 2)))
    body.position = body.approach = 3e-5 + 1e-9
    body.touch(1e-3)
    with pytest.raises(LabpipeError, match="ring around the axis"):
        body.run(1.0, NEVER_RESTS)


def test_work_per_step_does_not_grow_with_history():
    creep = Creep.from_terms(0.3e-9, np.full(4, 0.05e-9), np.logspace(-5, -2, 4))
    body = stepper(creep)
    work = []
    for _ in range(3):
        before = (body.counts.solver_steps, body.counts.spring_updates)
        body.touch(1e-3)
        body.run(1.0, NEVER_RESTS)
        body.fly(0.01)
        body.velocity, body.acceleration = SPEED, GRAVITY
        body.position = body.approach = float(body.memory[:, 0].sum())
        steps = body.counts.solver_steps - before[0]
        work.append((body.counts.spring_updates - before[1]) / steps)
    np.testing.assert_allclose(work, work[0], rtol=0.05)


def test_rest_is_told_from_a_turning_point_and_from_creep():
    body = stepper(Creep.from_terms(1e-9, [], []))
    test = RestTest(1e-4, period=1.0, speed=1.0)
    test.restart(0.0)
    body.force = MASS * GRAVITY
    swinging, creeping = [], []
    for i in range(400):
        body.time = i * 0.01
        body.velocity = 0.1 * np.cos(2 * np.pi * body.time)
        swinging.append(test(body))
    test.restart(body.time)
    for i in range(400):
        body.time = 4.0 + i * 0.01
        body.velocity = 0.1 - 1e-6 * i
        creeping.append(test(body))
    assert not any(swinging)
    assert any(creeping)


@pytest.mark.parametrize("solver", ["mdr", "rings"])
@pytest.mark.parametrize("height", [1.5e-3, 0.0])
@pytest.mark.parametrize("plate", [None, Plate(20.0, 180.0, 0.02)], ids=["floor", "plate"])
def test_compiled_steps_are_the_steps_of_numpy(solver, height, plate):
    material = Prony(1e9, [1e9, 5e8, 2e8], [1e-5, 5e-4, 1e-2], nu=0.35)
    runs = [
        drop(material, 9.525e-3, 0.505, height, 0.08, solver, plate=plate, compiled=compiled)
        for compiled in (True, False)
    ]
    fast, plain = runs
    assert fast.sizes == plain.sizes
    for name in fast.data_vars:
        like = "stored_energy" if name == "numerical_energy" else name
        scale = float(abs(plain[like]).max()) if plain[like].size else 0.0
        np.testing.assert_allclose(fast[name], plain[name], rtol=1e-9, atol=1e-10 * scale)
    works = [json.loads(run.attrs["work"]) for run in runs]
    # A step that is handed back is looked at twice; everything else is the same.
    for name in ("solver_steps", "rejected_steps", "rest_steps", "flights", "springs"):
        assert works[0][name] == works[1][name]


LIQUID = Prony(0.0, [2e9, 1e9], [1e-3, 1e-2], nu=0.35)
# A hundred thousand times stiffer at once than later: loads would ring from step to step.
RINGING = Prony.from_creep(1e6, [0.99999e-6], [1e-2], nu=0.35)


@pytest.mark.parametrize(
    ("material", "mass", "duration"),
    [(LIQUID, 0.505, 0.06), (RINGING, 0.005, 0.0148)],
    ids=["liquid", "ringing"],
)
def test_compiled_steps_follow_a_liquid_and_loads_that_would_ring(material, mass, duration):
    fast, plain = (
        drop(material, 9.525e-3, mass, 1e-3, duration, compiled=c) for c in (True, False)
    )
    for name in fast.data_vars:
        scale = float(abs(plain[name]).max()) if plain[name].size else 0.0
        np.testing.assert_allclose(fast[name], plain[name], rtol=1e-8, atol=1e-9 * scale)


@pytest.mark.parametrize("plate", [None, Plate(20.0, 180.0, 0.02)], ids=["floor", "plate"])
def test_a_drop_without_shortcuts_gives_the_same_answer(plate):
    material = Prony(1e9, [1e9, 5e8, 2e8], [1e-5, 5e-4, 1e-2], nu=0.35)
    times = np.linspace(0.0, 0.1, 301)
    none = Shortcuts(flights=False, near=False, rest=False)
    short, whole = (
        drop(material, 9.525e-3, 0.505, 1e-3, 0.1, plate=plate, times=times, shortcuts=chosen)
        for chosen in (Shortcuts(), none)
    )
    np.testing.assert_allclose(short.restitution, whole.restitution, rtol=1e-4)
    sag = 9.81 * 0.505 / 1e6
    np.testing.assert_allclose(short.displacement, whole.displacement, atol=1e-3 * sag)
    work = [json.loads(run.attrs["work"]) for run in (short, whole)]
    assert work[0]["solver_steps"] < work[1]["solver_steps"]
    assert work[0]["spring_updates"] < work[1]["spring_updates"]


@pytest.mark.parametrize("frequency", [180.0, 2500.0])
def test_approach_is_the_position_above_the_plate_up_to_the_lift_off(frequency):
    plate = Plate(0.05, frequency, 0.02)
    body = stepper(Creep.from_terms(0.3e-9, [0.2e-9], [1e-3]), plate=plate)
    body.touch(1e-3)
    assert body.run(1.0, NEVER_RESTS) == "lift-off"
    records = body.take_trail()
    moved = [(r.approach, r.position - r.plate.displacement) for r in records]
    np.testing.assert_allclose(*zip(*moved, strict=True), rtol=0, atol=1e-14)
    assert abs(records[-1].plate.displacement) > 1e-7
