"""The stepper of one contact: what it guards, and how its work counts."""

import json

import numpy as np
import pytest

from labpipe.contact import Shortcuts, drop
from labpipe.contact.impact._line_springs import line_springs
from labpipe.contact.impact._motion import Body, Stillness
from labpipe.contact.impact._plate import Plate
from labpipe.contact.impact._rings import ring_springs
from labpipe.contact.impact._stepper import Stepper
from labpipe.contact.memory import Creep
from labpipe.errors import LabpipeError
from labpipe.materials import Prony
from tests.labpipe.contact.numpy_contact import NumpyContact

R, MASS, GRAVITY, SPEED = 0.01, 0.5, 9.81, 0.2
TOLERANCE, TIME_SCALE = 1e-7, 1e-3
SPRINGS = {"mdr": line_springs(R, 2e-3, 1e-4, 60), "rings": ring_springs(R, 2e-3, 1e-5)}
NEVER_RESTS = Stillness(0.0, 1.0, 1.0)


def stepper(creep, memory=None, plate=None, springs=SPRINGS["mdr"], stillness=NEVER_RESTS):
    result = Stepper(
        creep_law=creep,
        springs=springs,
        body=Body(MASS, GRAVITY, plate),
        stillness=stillness,
        tolerance=TOLERANCE,
        time_scale=TIME_SCALE,
        speed_scale=SPEED,
        largest_radius=R,
        max_steps=100_000,
    )
    result.now.velocity, result.now.acceleration = SPEED, GRAVITY
    if memory is not None:
        result.memory[:] = memory(springs.position)
    return result


def test_lift_off_ends_with_no_force_at_the_centre():
    creep = Creep.from_terms(0.3e-9, [0.2e-9], [1e-3])
    body = stepper(creep)
    body.touch(1e-3)
    assert body.run(1.0) == "lift-off"
    assert body.now.force == 0.0
    # The sphere leaves exactly where the central spring has recovered to.
    assert body.now.approach == pytest.approx(float(body.memory[:, 0].sum()), rel=1e-13)
    assert body.now.velocity < 0.0


def test_a_contact_beyond_the_block_takes_more_springs_and_changes_nothing():
    creep = Creep.from_terms(0.3e-9, [0.2e-9], [1e-3])
    small, large = stepper(creep), stepper(creep)
    small.touch(1e-4)
    large.touch(1.5e-3)
    small.run(1.0)
    large.run(1.0)
    assert small.now.velocity == pytest.approx(large.now.velocity, rel=1e-10)
    assert small.now.time == pytest.approx(large.now.time, rel=1e-10)
    np.testing.assert_allclose(small.memory, large.memory, rtol=1e-8, atol=1e-20)


def test_a_surface_that_would_touch_in_a_ring_is_refused():
    """A dent that is deeper at the centre than the sphere is curved cannot be one disc."""
    creep = Creep.from_terms(0.3e-9, [0.2e-9], [1e3])
    body = stepper(creep, lambda x: 3e-5 * np.exp(-((x / 1e-4) ** 2)))
    body.now.position = body.now.approach = 3e-5 + 1e-9
    body.touch(1e-3)
    with pytest.raises(LabpipeError, match="ring around the axis"):
        body.run(1.0)


def test_work_per_step_does_not_grow_with_history():
    creep = Creep.from_terms(0.3e-9, np.full(4, 0.05e-9), np.logspace(-5, -2, 4))
    body = stepper(creep)
    work = []
    for _ in range(3):
        before = (body.counts.solver_steps, body.counts.spring_updates)
        body.touch(1e-3)
        body.run(1.0)
        body.fly(0.01)
        body.now.velocity, body.now.acceleration = SPEED, GRAVITY
        body.now.position = body.now.approach = float(body.memory[:, 0].sum())
        steps = body.counts.solver_steps - before[0]
        work.append((body.counts.spring_updates - before[1]) / steps)
    np.testing.assert_allclose(work, work[0], rtol=0.05)


@pytest.mark.parametrize(("share", "outcome"), [(1.0, "rest"), (0.9, "end")])
def test_rest_is_told_from_swinging_and_from_creep(share, outcome):
    """Released on its sag it creeps on without a swing; released above, it swings."""
    creep = Creep.from_terms(1e-9, [1e-12], [1e3])
    sag = (0.75 * MASS * GRAVITY * R * creep.instantaneous) ** (2 / 3) / R
    body = stepper(creep, stillness=Stillness(1e-3, 2e-3, GRAVITY * 2e-3 / (2 * np.pi)))
    body.now.velocity = 0.0
    body.touch(2.0 * np.sqrt(R * sag))
    body.now.position = body.now.approach = share * sag
    pressed = np.maximum(share * sag - body.block.gap, 0.0)
    body.block.load[:], body.block.displacement[:] = pressed / creep.instantaneous, pressed
    body.now.force = MASS * GRAVITY * share**1.5
    body.now.acceleration = GRAVITY * (1.0 - share**1.5)
    assert body.run(0.02) == outcome


LIQUID = Prony(0.0, [2e9, 1e9], [1e-3, 1e-2], nu=0.35)
SOLID = Prony(1e9, [1e9, 5e8, 2e8], [1e-5, 5e-4, 1e-2], nu=0.35)


@pytest.mark.parametrize("material", [SOLID, LIQUID], ids=["solid", "liquid"])
@pytest.mark.parametrize("solver", ["mdr", "rings"])
@pytest.mark.parametrize("plate", [None, Plate(20.0, 180.0, 0.02)], ids=["floor", "plate"])
def test_compiled_steps_are_the_steps_of_numpy(material, solver, plate):
    creep, springs = Creep.of(material), SPRINGS[solver]
    dent = 1e-7 * np.exp(-np.outer(1.0 + np.arange(creep.rate.size), (springs.position / 1e-3) ** 2))
    body = stepper(creep, lambda _: dent, plate, springs)
    body.now.position = body.now.approach = float(springs.gap[0] + dent[:, 0].sum())
    body.touch(1.5e-3)
    assert body.run(1.0) == "lift-off"
    found = body.take_trail()[1:]
    oracle = NumpyContact(creep, springs, body.body, TOLERANCE, TIME_SCALE, SPEED, dent)
    expected = oracle.run()
    assert found.size == len(expected) > 200
    outside = body.block.gap.size
    lost = 0.5 * creep.inverse @ (dent[:, outside:] ** 2 @ springs.weight[outside:])
    for name, values in zip(("time", "position", "velocity", "force", "stored"), expected.T, strict=True):
        np.testing.assert_allclose(found[name], values, rtol=1e-9, atol=1e-10 * abs(values).max() + lost)


@pytest.mark.parametrize("plate", [None, Plate(20.0, 180.0, 0.02)], ids=["floor", "plate"])
def test_a_drop_without_shortcuts_gives_the_same_answer(plate):
    """Both are stepped, the first because of its maps; the collocated run agrees within rtol."""
    material = Prony(1e9, [1e9, 5e8, 2e8], [1e-5, 5e-4, 1e-2], nu=0.35)
    times = np.linspace(0.0, 0.1, 301)
    none = Shortcuts(flights=False, near=False, rest=False)
    short, whole = (
        drop(material, 9.525e-3, 0.505, 1e-3, 0.1, plate=plate, times=times, maps=[0.1], shortcuts=chosen)
        for chosen in (Shortcuts(), none)
    )
    np.testing.assert_allclose(short.restitution, whole.restitution, rtol=1e-4)
    sag = 9.81 * 0.505 / 1e6
    np.testing.assert_allclose(short.displacement, whole.displacement, atol=1e-3 * sag)
    work = [json.loads(run.attrs["work"]) for run in (short, whole)]
    assert work[0]["solver_steps"] < work[1]["solver_steps"]
    assert work[0]["spring_updates"] < work[1]["spring_updates"]
    collocated = drop(material, 9.525e-3, 0.505, 1e-3, 0.1, plate=plate, times=times)
    np.testing.assert_allclose(collocated.restitution[:2], whole.restitution[:2], rtol=1e-4)


@pytest.mark.parametrize("frequency", [180.0, 2500.0])
def test_approach_is_the_position_above_the_plate_up_to_the_lift_off(frequency):
    plate = Plate(0.05, frequency, 0.02)
    body = stepper(Creep.from_terms(0.3e-9, [0.2e-9], [1e-3]), plate=plate)
    body.touch(1e-3)
    assert body.run(1.0) == "lift-off"
    records = body.take_trail()
    moved = records["position"] - records["plate_displacement"]
    np.testing.assert_allclose(records["approach"], moved, rtol=0, atol=1e-14)
    assert abs(records["plate_displacement"][-1]) > 1e-7
