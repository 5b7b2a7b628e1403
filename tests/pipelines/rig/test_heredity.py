"""The rig's hereditary integral against internal variables and against the bare sum over all steps."""

import numpy as np
import pytest

from labpipe import materials
from labpipe.compilation import lean
from pipelines.rig.heredity import History, no_history, pull, remember, stiffness_of_step
from pipelines.rig.solids import SOLIDS, Viscoelastic, solid_of

SECONDS = np.concatenate([np.full(300, 2e-6), 2e-6 * 1.15 ** np.arange(60), np.full(300, 2e-6)])
TIME = np.concatenate([[0.0], np.cumsum(SECONDS)])
PULSES = 1e-4 * np.sin(np.pi * np.clip(TIME / 6e-4, 0.0, 1.0)) + 1e-4 * np.sin(
    np.pi * np.clip((TIME - TIME[360]) / 6e-4, 0.0, 1.0)
)
WALK = 1e-5 * np.concatenate([[0.0], np.cumsum(np.random.default_rng(1).standard_normal(SECONDS.size))])


@lean()
def _pressed(history: History, begin: float, end: float, rise: np.ndarray, base: np.ndarray) -> float:
    """One step: fill in the stress of springs that rest in it, remember it, return the stiffness."""
    pull(history, end, base.size, base)
    remember(history, begin, end, rise, base.size)
    return stiffness_of_step(history, end - begin)


def marched(solid: Viscoelastic, displacement: np.ndarray) -> np.ndarray:
    """Stress of springs (time, spring) that are led through a history."""
    springs = displacement.shape[1]
    history, base, stress = no_history(solid, springs), np.zeros(springs), np.zeros_like(displacement)
    for n in range(1, TIME.size):
        rise = displacement[n] - displacement[n - 1]
        stress[n] = _pressed(history, TIME[n - 1], TIME[n], rise, base) * rise + base
    assert history.blocks[0] < 80  # not one per step
    return stress


def test_a_prony_series_gives_what_its_internal_variables_give() -> None:
    series = materials.load("ptfe")
    E, rho = np.asarray(series.E), np.asarray(series.rho)
    displacement = np.column_stack([PULSES, WALK])
    memory, known = np.zeros((2, E.size)), np.zeros_like(displacement)
    for n in range(1, TIME.size):
        x = (TIME[n] - TIME[n - 1]) / rho
        memory = memory * np.exp(-x) + np.outer(displacement[n] - displacement[n - 1], -np.expm1(-x) / x)
        known[n] = series.E_relaxed * displacement[n] + memory @ E
    error = np.abs(marched(solid_of(series), displacement) - known).max(axis=0)
    assert (error < 2e-5 * np.abs(known).max(axis=0)).all()


@pytest.mark.parametrize("name", ["nbr", "ptfe"])
def test_blocks_of_steps_give_what_all_steps_give(name: str) -> None:
    """The sum over every step, each with the true mean of E over it, at a few moments."""
    solid = SOLIDS[name].at()
    stress = marched(solid, PULSES[:, None])[:, 0]
    rise = np.diff(PULSES)
    for n in (200, 359, 361, 500, 660):
        begin, end = TIME[n] - TIME[:n], TIME[n] - TIME[1 : n + 1]
        whole = np.append(begin[:-1] * solid.mean_relaxation(begin[:-1]), begin[-1] * solid.mean_relaxation(begin[-1:]))
        rest = np.append(end[:-1] * solid.mean_relaxation(end[:-1]), 0.0)
        known = ((whole - rest) / (begin - end) * rise[:n]).sum()
        assert stress[n] == pytest.approx(known, abs=1e-5 * np.abs(stress).max())


@pytest.mark.parametrize("name", sorted(SOLIDS))
def test_relaxation_and_creep_of_a_solid_belong_together(name: str) -> None:
    """The integral of J(t - s) E(s) over s is t (thesis 1.6), by Gauss's rule in ln s from both ends."""
    solid = SOLIDS[name].at()
    node, weight = np.polynomial.legendre.leggauss(60)
    for t in (1e-4, 1.0, 600.0):
        x = 0.5 * (np.log(0.5 * t) - np.log(1e-12 * t)) * (node + 1) + np.log(1e-12 * t)
        s, w = np.exp(x), 0.5 * np.log(0.5 / 1e-12) * weight * np.exp(x)
        sides = solid.creep(t - s) * solid.relaxation(s) + solid.creep(s) * solid.relaxation(t - s)
        assert (w * sides).sum() == pytest.approx(t, rel=1e-6)
