"""What experiments tell of a material: numbers and uncertainties against the rig's truth."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from labpipe import materials
from labpipe.materials import Prony
from labpipe.workflow.results import Results
from pipelines.experiments import KINDS
from pipelines.experiments.harmonic import evidence
from pipelines.experiments.harmonic.model import along_chords
from pipelines.experiments.shared import mach1_readings
from pipelines.session import derive, opened


@pytest.fixture(scope="module")
def results(processed_session: Path) -> Results:
    return opened(processed_session)


def simulated(results: Results, solid: Prony) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stiffness of the simulated and of the true oscillations, and the true size."""
    told: Any = derive(results, results.experiments["nbr"], KINDS["harmonic"].evidence, name="nbr", impacts=6)
    loads = results.result("nbr", "loads")
    touch = mach1_readings.touch_of(mach1_readings.first_touch(loads, None))
    truth = json.loads((results.plan.session.root / "truth/nbr.json").read_text(encoding="utf-8"))
    given = {p.name: p.mean for p in told.unknowns}
    given["nbr first touch"] = truth["surface"] - touch.value
    made = told.build(np.asarray(solid.rho)).model.predict(solid, given, is_full=True)
    known = [np.array([o[f"{part}_stiffness"] for o in truth["oscillations"]]) for part in ("storage", "loss")]
    return made, np.concatenate(known), np.tile(np.hypot(*known), 2)


def test_an_oscillation_is_simulated_as_the_rig_makes_it(results: Results) -> None:
    """Fifty readings a cycle: their chords alone cost more than the stated uncertainty."""
    solid = materials.load("nbr")
    made, known, size = simulated(results, solid)
    assert np.abs((made - known) / size).max() < 2e-4
    frequency = results.result("nbr", "oscillations")["frequency"].values.tolist()
    chords = np.array([along_chords(solid, 0.01, f) for f in frequency])
    storage, loss = np.split(made, 2)
    bare = (storage + 1j * loss) * chords
    assert np.abs((bare.real - known[: storage.size]) / size[: storage.size]).max() > 5e-4


def test_chords_change_the_modulus_of_a_term_as_a_fine_integration_finds() -> None:
    """A Maxwell term along chords of a sinusoid, each cut into 200 exact steps."""
    frequency, cycles, cut, rho, samples = 2.0, 12, 200, 0.07, 10
    interval = 1.0 / frequency / samples
    coarse = np.arange(cycles * samples + 1) * interval
    fine = np.linspace(0.0, coarse[-1], cycles * samples * cut + 1)
    strain = np.interp(fine, coarse, np.sin(2 * np.pi * frequency * coarse))
    decay = np.exp(-interval / cut / rho)
    stress = np.zeros(fine.size)
    for n, rise in enumerate(np.diff(strain)):
        stress[n + 1] = stress[n] * decay + rise * np.sqrt(decay)
    last = slice(-samples * cut - 1, -1, cut)
    turn = np.exp(-2j * np.pi * frequency * fine[last])
    found = (stress[last] @ turn) / (strain[last] @ turn)
    solid = Prony(1e-9, [1.0], [rho])
    exact = solid.complex_modulus(2 * np.pi * frequency)
    assert along_chords(solid, interval, frequency) == pytest.approx(found / exact, rel=1e-5)


def test_the_gain_and_the_delay_of_the_cell_are_no_noise(results: Results) -> None:
    """Both are unknowns of their own: stated ten times as uncertain they leave the noise alone."""
    loads, waves = (results.result("nbr", stage) for stage in ("loads", "oscillations"))
    own = []
    for more in (0.0, 1e-3, 1e-2):
        said = loads.assign(u_gain=loads["gain"] * more)
        stated = waves.copy()
        for part in ("storage", "loss"):
            stated[f"u_{part}_stiffness"] = np.hypot(waves[f"u_{part}_stiffness"], more * waves[f"{part}_stiffness"])
        storage, loss, by_phase = evidence._stiffness(said, stated)
        own.append(np.concatenate([storage[1], loss[1]]))
    np.testing.assert_allclose(own, [own[0]] * 3, rtol=1e-6)
    assert (own[0] < np.abs(by_phase).max()).all()
