"""Static loading: approach, radius, creep and first touch against the rig's truth."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import xarray as xr

from labpipe import materials
from labpipe.errors import ConfigError
from labpipe.materials import Prony
from labpipe.uncertainty import linear_budget
from labpipe.units import quantity
from pipelines.experiments.static_loading import comparison, measured as static_loading, model
from pipelines.rig.session_text import laser_record
from pipelines.rig.static_loading import StaticRig, static_section, write_static
from pipelines.session import open_session, result
from tests.pipelines.budgets import quantities
from tests.pipelines.sessions import begun, copied, processed, settings_of, truth
from tests.pipelines.small import START

RIG = StaticRig()
NAME = "ptfe_static"


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("static")
    file = write_static(folder, NAME, RIG, materials.load("ptfe"), 21, START)
    return processed(begun(folder, static_section(NAME, file, RIG, "ptfe"), laser=laser_record()))


def stage(session: Path, name: str) -> xr.Dataset:
    return result(session, NAME, name)


def true_levels(session: Path, steps: xr.Dataset, approach: xr.Dataset) -> tuple[Any, Any]:
    """True approach and creep of every load in the windows that were used."""
    known = truth(session, NAME)
    depth = np.interp(approach["time"].values, known["time"], known["approach"])
    levels, creeps = [], []
    for begin, end in zip(steps["begin"].values, steps["end"].values, strict=True):
        first, last = static_loading.windows(approach["time"].values, (begin, end), settings_of(session, NAME))
        levels.append(depth[last].mean())
        creeps.append(depth[last].mean() - depth[first].mean())
    return np.array(levels), np.array(creeps)


def test_the_loads_are_found_when_they_were_put_on(session: Path) -> None:
    found = stage(session, "steps")
    gap = found["begin"].values - np.array(truth(session, NAME)["load_times"])
    assert np.abs(gap).max() <= 2.5  # half the time between two readings


def test_approach_radius_and_creep_are_the_true_ones(session: Path) -> None:
    steps, found = stage(session, "steps"), stage(session, "approach")
    level, creep = true_levels(session, steps, found)
    radius = np.sqrt(RIG.radius * level)
    for name, known in (("level_approach", level), ("level_contact_radius", radius), ("creep", creep)):
        z = (found[name].values - known) / found[f"u_{name}"].values
        assert np.abs(z).max() < 3.5, name
    assert float(found["u_level_contact_radius"][-1]) < 2e-6


def test_the_compliance_follows_from_the_record_alone(session: Path) -> None:
    found = stage(session, "steps")
    solid = materials.load("ptfe")
    lag = found["elapsed"].values
    known = np.asarray(solid.creep(lag)) * (1 - float(solid.nu) ** 2)
    inside = (lag > 30.0) & (lag < 2000.0)
    assert np.abs(found["compliance"].values / known - 1)[inside].max() < 0.02


def test_the_model_of_the_right_material_agrees(session: Path) -> None:
    found = stage(session, "comparison")
    assert float(found["nrmse_contact_radius_model"]) < 0.01
    z = found["radius_difference"].values / found["u_radius_difference"].values
    assert np.abs(z).max() < 3.5
    assert float(found["curve_p"]) > 0.01
    assert 3.0 < float(found["curve_degrees_of_freedom"]) <= 15.0


def test_hertz_misses_the_creep_that_the_model_has(session: Path) -> None:
    compared, found = stage(session, "comparison"), stage(session, "approach")
    creep = found["creep"].values
    assert np.all(creep > 2 * found["u_creep"].values)
    model_gap = creep - compared["creep_model"].values
    assert np.abs(model_gap).sum() < 0.5 * np.abs(creep).sum()
    assert float(compared["nrmse_contact_radius_model"]) < float(compared["nrmse_contact_radius_hertz"])


def compared(session: Path, chosen: Any) -> xr.Dataset:
    steps, found = stage(session, "steps"), stage(session, "approach")
    made = model.model(stage(session, "displacement"), steps, None, None, settings=chosen)
    return comparison.comparison(stage(session, "displacement"), steps, found, made, settings=chosen)


def test_a_modulus_a_quarter_too_low_shows(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model, "resolve", lambda *_: materials.load("ptfe").scaled(0.75))
    found = compared(session, settings_of(session, NAME))
    assert float(found["nrmse_contact_radius_model"]) > 0.06
    assert float(found["curve_p"]) < 1e-6


def test_a_solid_without_a_plateau_is_held_against_hertz_at_the_end(
    session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sweeps of a glass may leave its relaxed modulus at nothing, and Hertz's contact with it has no end."""
    solid = materials.load("ptfe")
    flowing = Prony(0.0, np.asarray(solid.E), solid.rho, nu=solid.nu)
    monkeypatch.setattr(model, "resolve", lambda *_: flowing)
    found = compared(session, settings_of(session, NAME))
    assert str(found.attrs["reference"]).startswith("modulus after ")
    assert np.isfinite(found["hertz_difference"].values).all()
    assert np.isfinite(float(found["curve_p"]))


def test_times_need_not_be_given_and_one_half_a_minute_off_is_told(session: Path) -> None:
    """2.55 min may mean two minutes and 55 s."""
    chosen, moved = settings_of(session, NAME), stage(session, "displacement")
    loads = [msgspec.structs.replace(load, time=None) for load in chosen.loads]
    found = static_loading.steps(moved, settings=msgspec.structs.replace(chosen, loads=loads))
    np.testing.assert_allclose(found["begin"], stage(session, "steps")["begin"])
    loads = list(chosen.loads)
    loads[2] = msgspec.structs.replace(loads[2], time=quantity("1145 s"))
    with pytest.warns(UserWarning, match=r"3.5 kg: 109\d s, given 1145 s"):
        static_loading.steps(moved, settings=msgspec.structs.replace(chosen, loads=loads))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('mass = "2.5 ± 0.0005 kg"', 'mass = "0.2 kg"', "each must exceed the one before"),
        ('mass = "2.5 ± 0.0005 kg"', 'mass = "4.0 kg"', "loads 2 and 3 are probably exchanged"),
        ('mass = "3.5 ± 0.0005 kg"', 'mass = "0.1 kg"', "the totals to state are 0.5 kg, 3 kg, 3.1 kg"),
        ('time = "18.20 min"', 'time = "1 min"', "times must grow"),
    ],
)
def test_mistakes_in_the_settings_are_told(session: Path, tmp_path: Path, old: str, new: str, told: str) -> None:
    wrong = copied(session, tmp_path, old, new, ignored="labpipe")
    with pytest.raises(ConfigError) as caught:
        open_session(wrong)
    assert told in " ".join(map(str, caught.value.problems))


def test_budgets_are_those_of_the_results(session: Path) -> None:
    found = quantities(session, NAME)
    levels, model = stage(session, "approach"), stage(session, "model")
    for name, value, u in (
        ("approach under the last load", levels["level_approach"], levels["u_level_approach"]),
        ("contact radius under the last load", levels["level_contact_radius"], levels["u_level_contact_radius"]),
        ("contact radius of the model under the last load", model["contact_radius"], model["u_contact_radius"]),
    ):
        budget = linear_budget(found[name].model, found[name].inputs)
        assert budget.value == pytest.approx(float(value[-1]), rel=1e-9)
        assert budget.u == pytest.approx(float(u[-1]), rel=0.02)
