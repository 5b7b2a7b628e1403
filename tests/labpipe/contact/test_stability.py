"""Hostile input to the contact mechanics: right within a bound, or refused with a reason.

What is generated stands in ``tests/extremes``; here are long and single cases.
"""

import numpy as np
import pytest

from labpipe.contact import indent, load_sphere, press_sphere
from labpipe.contact.memory._creep import Creep, advance, history, step_weights
from labpipe.contact.springs._bed import sphere_bed
from labpipe.contact.springs._march import March
from labpipe.errors import InputError
from labpipe.materials import Prony


@pytest.mark.slow
def test_a_hundred_thousand_cycles_do_not_drift() -> None:
    """One spring through 1e5 cycles: the recursion repeats itself to rounding."""
    material = Prony(1e6, [1e6, 2e6, 5e6], [1e-3, 0.1, 2.0], nu=0.4)
    per_cycle, cycles = 4, 100_000
    creep = Creep.of(material)
    weights = step_weights(creep, 1.0 / per_cycle)
    load = 1.0 - np.cos(2 * np.pi * np.arange(per_cycle) / per_cycle)
    memory, past = creep.rest(1), load[:1]
    shown = np.zeros((2, per_cycle))
    for n in range(1, per_cycle * cycles + 1):
        new = load[n % per_cycle : n % per_cycle + 1]
        unloaded = history(weights, memory, past)
        memory, past = advance(weights, memory, past, new), new
        if n > per_cycle * (cycles - 1):
            shown[1, n % per_cycle] = unloaded[0] + weights.compliance * new[0]
        elif per_cycle * 999 < n <= per_cycle * 1000:
            shown[0, n % per_cycle] = unloaded[0] + weights.compliance * new[0]
    assert np.abs(shown[1] - shown[0]).max() < 1e-13 * shown.max()


def test_zero_length_holds_and_repeated_times_change_nothing() -> None:
    material = Prony(1e6, [1e8], [1e-3], nu=0.3)
    plain = press_sphere(material, 0.01, [0.0, 1.0, 2.0], [0.0, 1e-5, 1e-5])
    held = press_sphere(material, 0.01, [0.0, 1.0, 1.0, 1.0, 2.0, 2.0], [0.0, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5])
    assert held.force.values[[0, 1, 4]] == pytest.approx(plain.force.values, rel=1e-12)
    assert held.force.values[5] == held.force.values[4]


def test_a_missing_sample_is_named() -> None:
    material = Prony(1e6, [1e8], [1e-3], nu=0.3)
    with pytest.raises(InputError, match=r"displacement\[2\] is nan"):
        indent(material, 2e-3, 8e-3, 1.0, [0.0, 1.0, 2.0], [0.0, 1e-5, np.nan])
    with pytest.raises(InputError, match=r"load\[1\] is inf"):
        load_sphere(material, 0.01, [0.0, 1.0], [0.0, np.inf])


def test_steps_of_one_interval_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tolerance that cannot be met ends with a reason, not in an endless loop."""
    monkeypatch.setattr("labpipe.contact.springs._march._MAX_STEPS_PER_INTERVAL", 5)
    material = Prony(1e3, [1e7], [1e-9], nu=0.3)
    march = March(sphere_bed(0.01, 1e-3, 20), Creep.of(material), "displacement", 1e-10)
    with pytest.raises(InputError, match="more than 5 steps"):
        list(march.run(np.array([0.0, 1.0]), np.array([1e-5, 2e-5])))
