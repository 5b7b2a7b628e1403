from dataclasses import replace

import numpy as np
import pytest

from labpipe import contact
from labpipe.errors import InputError
from labpipe.identification import (
    Bounces,
    DropModel,
    Parameter,
    Problem,
    SmoothSpectrum,
    drop_evidence,
    fit,
    moduli,
    posterior,
)
from labpipe.materials import Prony

SOLID = Prony(2e9, [2e8, 2e8, 2e8], [1e-4, 1e-3, 1e-1], nu=0.35)
NONE = np.full(3, np.nan)
NAMES = {r: r for r in ("height", "mass", "radius", "modulus", "trigger", "pixel")}
GIVEN = {"height": 1.5e-3, "mass": 0.505, "radius": 9.525e-3, "modulus": 1.0, "trigger": 0.0, "pixel": 1.0}


def seen() -> Bounces:
    made = contact.drop(SOLID, 9.525e-3, 0.505, 1.5e-3, 0.12, rtol=1e-5, times=[0.0])
    touch = made["impact_time"].values[:3] - float(made["impact_time"][0])
    u = np.ones(3)
    return Bounces(
        touch, 2e-5 * u, made["contact_duration"].values[:3], 1e-5 * u, made["peak_contact_radius"].values[:3], 3e-6 * u
    )


def model(**names: str) -> DropModel:
    empty = np.empty(0, int)
    return DropModel(9.525e-3, 0.505, 1.5e-3, 9.81, empty, empty, empty, 0.0, 0.0, names)


@pytest.fixture(scope="module")
def evidence():
    return drop_evidence("drop", seen(), model(**NAMES))


@pytest.fixture(scope="module")
def derivatives(evidence):
    return evidence.model.derivatives(SOLID, GIVEN)


def test_model_predicts_what_the_simulator_gives(evidence) -> None:
    assert np.allclose(evidence.model.predict(SOLID, GIVEN), evidence.values, rtol=1e-3)
    assert np.allclose(evidence.model.predict(SOLID, GIVEN, is_full=True), evidence.values, rtol=1e-4)


def direct(name: str, change: float, plate: contact.Plate | None = None) -> np.ndarray:
    """Derivative of what a drop shows by differences of two simulations."""
    ends = []
    for sign in (1, -1):
        body = {"mass": 0.505, "radius": 9.525e-3, "modulus": 1.0, "height": 1.5e-3}
        body[name] += sign * change
        solid = SOLID.scaled(body["modulus"])
        made = contact.drop(
            solid, body["radius"], body["mass"], body["height"], 0.12, plate=plate, times=[0.0], rtol=1e-4
        )
        touch = made["impact_time"].values
        seen = touch[1:3] - touch[0], made["contact_duration"].values[:3], made["peak_contact_radius"].values[:3]
        ends.append(np.concatenate(seen))
    return (ends[0] - ends[1]) / (2 * change)


@pytest.mark.parametrize(("name", "change"), [("mass", 0.01), ("radius", 2e-4), ("modulus", 0.02)])
def test_mass_radius_and_poissons_ratio_act_as_a_factor_of_the_moduli(derivatives, name, change) -> None:
    known = direct(name, change)
    assert np.allclose(derivatives[1][name], known, rtol=0.03, atol=1e-3 * np.abs(known).max())


@pytest.mark.parametrize(("name", "change"), [("mass", 5e-4), ("height", 5e-6)])
def test_plate_moves_by_the_ratio_of_the_masses(evidence, name, change) -> None:
    plate = contact.Plate(30.0, 180.0, 0.03)
    model = replace(evidence.model, plate=plate, names={**evidence.model.names, "plate": "plate"})
    known, found = direct(name, change, plate)[:2], model.derivatives(SOLID, {**GIVEN, "plate": 30.0})[1][name][:2]
    assert np.allclose(found, known, rtol=0.05, atol=0.02 * np.abs(known).max())


def test_terms_quicker_than_a_contact_are_dashpots(evidence) -> None:
    quick = Prony(2e9, [1e8, 1e8, 2e8], [1e-8, 1e-7, 1e-4], nu=0.35)
    made, _ = evidence.model.derivatives(quick, GIVEN)
    assert np.allclose(made[:, 1], 0.1 * made[:, 2])
    # a tenth of the modulus in place of a differential: the effect is linear in a small viscosity
    more = Prony(2e9, [1e8, 3e8, 2e8], [1e-8, 1e-7, 1e-4], nu=0.35)
    full = replace(evidence.model, rtol=1e-5)
    direct = (full.predict(more, GIVEN, is_full=True) - full.predict(quick, GIVEN, is_full=True)) / 2e8
    assert np.allclose(made[:5, 2], direct[:5], rtol=0.15, atol=0.02 * np.abs(made[:5, 3]).max())


def test_shape_of_the_pulse_moves_all_durations_alike() -> None:
    shared = np.array([2e-6, 2.1e-6, 2.2e-6])
    told = replace(seen(), radius=NONE, shared_duration=shared)
    made = drop_evidence("drop", told, model(pulse="pulse")).model
    _, others = made.derivatives(SOLID, {"pulse": 0.0})
    added = made.predict(SOLID, {"pulse": 2.0}) - made.predict(SOLID, {"pulse": 0.0})
    assert np.allclose(added, [0, 0, *(2 * shared)], atol=1e-15)
    assert np.allclose(others["pulse"], [0, 0, *shared], atol=1e-15)


def test_few_impacts_identify_modulus_and_loss_at_their_own_frequency() -> None:
    evidence = drop_evidence("drop", replace(seen(), radius=NONE), model(height="height"))
    spectrum = SmoothSpectrum(np.array([1e-4, 1e-3, 1e-2, 1.0]), 0.35)
    height = Parameter("height", 1.5e-3, 5e-6, "m", "height", is_nuisance=True)
    problem = Problem(spectrum, (evidence,), (height,))
    start = np.append(spectrum.start(2e9, 0.1), 0.0)
    known = posterior(fit(problem, start=start))
    frequency = np.array([0.5 / float(evidence.groups[1].values[0])])
    found = moduli(known, frequency)
    truth = complex(SOLID.complex_modulus(2 * np.pi * frequency)[0])
    assert abs(np.log(found.storage[0] / truth.real)) < 3 * found.u_ln_storage[0]
    loss = truth.imag / truth.real
    assert abs(np.log(found.loss_factor[0] / loss)) < 3 * found.u_ln_loss_factor[0]
    assert found.u_ln_storage[0] < 0.05
    assert found.is_determined[0]
    with pytest.raises(InputError, match="no bounce"):
        drop_evidence("drop", Bounces(NONE, NONE, NONE, NONE, NONE, NONE), model())
