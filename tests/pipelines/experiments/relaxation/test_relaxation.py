"""Relaxation tests: forces, depth and moduli against the rig's truth, and the model beside them."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
import xarray as xr

from labpipe import files, materials
from labpipe.materials import Prony
from labpipe.uncertainty import linear_budget
from labpipe.units import Quantity
from pipelines.experiments.relaxation import comparison, measured as relaxation
from pipelines.experiments.shared import mach1_readings, punch_model
from pipelines.experiments.shared.punch_model import Geometry, elastic_force
from pipelines.experiments.shared.punch_settings import IndentationModel, Punch
from pipelines.rig.indentations import TESTER, Relaxation, Specimen, relaxation_section, write_relaxation
from pipelines.rig.session_text import cell_record
from pipelines.session import result
from tests.pipelines.budgets import quantities
from tests.pipelines.sessions import begun, page_of, processed, settings_of, truth
from tests.pipelines.shown import texts_between
from tests.pipelines.small import START

SAMPLES = Path(__file__).parents[4] / "../shared/samples/mach1"
DEPTHS = (0.1e-3, 0.3e-3)
PUNCH = Punch(radius=Quantity(2e-3, 0.0, "m"), period=Quantity(8e-3, 0.0, "m"), depth=Quantity(6e-3, 0.0, "m"), tips=3)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, specimen = tmp_path_factory.mktemp("relaxation"), Specimen(materials.load("nbr"))
    names = write_relaxation(folder, "nbr", specimen, Relaxation(depths=DEPTHS, hold=30.0), TESTER, 3, START)
    section = relaxation_section("nbr", names, specimen) + "elements = 512\n"
    return processed(begun(folder, section, load_cell=cell_record()))


def test_depth_peak_and_plateau_are_the_true_ones(session: Path) -> None:
    found = result(session, "nbr", "tests")
    for i, depth in enumerate(DEPTHS):
        known = truth(session, f"nbr_{depth * 1e6:.0f}um")
        assert abs(float(found["depth"][i]) - depth) < 3 * float(found["u_depth"][i])
        gap = float(found["plateau_force"][i]) - known["plateau_force"]
        assert abs(gap) < 3 * float(found["u_plateau_force"][i])
        # the filter hides some of the peak
        assert float(found["peak_force"][i]) < known["peak_force"]
        assert float(found["speed"][i]) == pytest.approx(1e-3, rel=1e-3)


def test_the_modulus_is_the_plateau_over_the_elastic_force_of_the_true_depth(session: Path) -> None:
    found = result(session, "nbr", "tests")
    chosen = settings_of(session, "nbr")
    geometry = Geometry.of(chosen.punch, chosen.substrate, chosen.model, 0.5)
    for i, depth in enumerate(DEPTHS):
        area = float(elastic_force(np.array([depth]), geometry)[0])
        known = truth(session, f"nbr_{depth * 1e6:.0f}um")["plateau_force"] / area
        gap = float(found["reduced_modulus"][i]) - known
        assert abs(gap) < 3 * float(found["u_reduced_modulus"][i])
    low, high = found["reduced_modulus"].values.min(), found["reduced_modulus"].values.max()
    assert low <= float(found["mean_reduced_modulus"]) <= high
    assert float(found["mean_relaxed_modulus"]) == pytest.approx(0.75 * float(found["mean_reduced_modulus"]))


def test_the_modulus_by_the_printed_equation_is_that_of_a_cosine() -> None:
    """Rows of the thesis: 12.40, 30.90, 54.81 N belong to 10.14 MPa at 0.1, 0.2, 0.3 mm."""
    cosine = Geometry.of(PUNCH, None, IndentationModel(profile="cosine"), None)
    found = 10.14e6 * elastic_force(np.array([0.1e-3, 0.2e-3, 0.3e-3]), cosine)
    # the modulus is printed to four digits
    np.testing.assert_allclose(found, [12.40, 30.90, 54.81], rtol=5e-4)


def test_the_model_of_the_right_material_agrees_in_every_part(session: Path) -> None:
    found = result(session, "nbr", "tests")
    for part in ("ramp", "early", "late", "all"):
        assert float(found[f"nrmse_{part}"].max()) < 0.01, part


@pytest.mark.parametrize(
    ("stiffness", "radius", "part", "least"),
    [
        ((1.1, 1.1), 2e-3, "all", 0.05),  # a tenth too stiff
        ((1.0, 0.0), 2e-3, "early", 0.08),  # without its relaxation
        ((1.0, 1.0), 2.6e-3, "all", 0.03),  # the force hardly depends on the radius: a third shows
    ],
)
def test_a_wrong_input_of_the_model_shows(
    session: Path, monkeypatch: pytest.MonkeyPatch, stiffness: tuple[float, ...], radius: float, part: str, least: float
) -> None:
    rubber, chosen = materials.load("nbr"), settings_of(session, "nbr")
    relaxed, terms = stiffness
    solid = Prony(float(rubber.E_relaxed) * relaxed, np.asarray(rubber.E) * terms, rubber.rho, nu=rubber.nu)
    monkeypatch.setattr(punch_model, "resolve", lambda *_: solid)
    punch = msgspec.structs.replace(chosen.punch, radius=Quantity(radius, 0.0, "m"))
    changed = msgspec.structs.replace(chosen, punch=punch)
    loads, ramps = (result(session, "nbr", stage, settings_of(session, "nbr").mach1[0]) for stage in ("loads", "ramps"))
    made = punch_model.model(loads, ramps, None, None, settings=changed)
    found = comparison.comparison(loads, ramps, made, settings=changed)
    assert float(found[f"nrmse_{part}"][0]) > least


def test_without_a_punch_the_forces_are_reported_and_the_reason_is_told(session: Path, tmp_path: Path) -> None:
    text = (session / "session.toml").read_text("utf-8")
    bare = text[: text.index("[experiments.nbr.punch]")]
    for name in settings_of(session, "nbr").mach1:
        files.write_bytes(tmp_path / name, (session / name).read_bytes())
    files.write_text(tmp_path / "session.toml", bare)
    found = result(processed(tmp_path), "nbr", "tests")
    assert "reduced_modulus" not in found
    assert (found["peak_force"] > found["plateau_force"]).all()
    page = page_of(tmp_path, "nbr")
    assert "names no punch" in page
    assert not any("model" in text for text in texts_between(page, "tests", "methods-text-to-paste"))


def history(*moves: tuple[float, float], rate: float = 100.0) -> xr.Dataset:
    """One block of ramps (travel in m) with holds (s) at 1 mm/s, and a force of 1 N/mm."""
    position, segment = [np.zeros(1)], [np.zeros(1)]
    for number, (travel, hold) in enumerate(moves):
        count = max(1, round(abs(travel) / 1e-3 * rate))
        start = position[-1][-1]
        ramp = start + travel * np.arange(1, count + 1) / count
        part = np.concatenate([ramp, np.full(round(hold * rate), start + travel)])
        position.append(part)
        segment.append(np.full(part.size, number))
    z = np.concatenate(position)
    attrs = {"units": "m", "long_name": "position"}
    return xr.Dataset(
        {
            "position_z": ("sample", z, attrs),
            "force": ("sample", z * 1e3, {"units": "N", "long_name": "force"}),
            "function": ("block_index", ["Stress Relaxation"]),
        },
        coords={
            "time": ("sample", np.arange(z.size) / rate),
            "block": ("sample", np.zeros(z.size, dtype=int)),
            "segment": ("sample", np.concatenate(segment)),
        },
    )


def test_every_ramp_of_a_block_is_found() -> None:
    found = relaxation.find(history((0.1e-3, 5.0), (0.2e-3, 4.0), (0.05e-3, 3.0)))
    for name, values, tolerance in (
        ("held", [0.1e-3, 0.3e-3, 0.35e-3], 1e-12),
        ("travel", [0.1e-3, 0.2e-3, 0.05e-3], 1e-12),
        ("duration", [5.0, 4.0, 3.0], 0.03),
        ("speed", [1e-3] * 3, 1e-9),
    ):
        np.testing.assert_allclose([hold[name] for hold in found], values, atol=tolerance)


@pytest.mark.skipif(not SAMPLES.is_dir(), reason="the shared samples are not beside the checkout")
def test_the_three_ramps_of_a_real_file() -> None:
    chosen = relaxation.Relaxation(kind="relaxation", mach1=["a.txt"])
    readings = mach1_readings.readings(SAMPLES / "stress_relaxation_3_ramps.txt")
    with pytest.warns(UserWarning, match="begins in contact"):
        loads = mach1_readings.loads(readings, None, settings=chosen)
    with pytest.warns(UserWarning, match="no modulus|not relaxed"):
        found = relaxation.ramps(loads, settings=chosen)
    assert found.sizes["ramp"] == 3
    np.testing.assert_allclose(found["travel"], 39.3e-6, atol=0.3e-6)
    np.testing.assert_allclose(found["speed"], 0.7e-6, rtol=0.05)
    assert (found["peak_force"] > found["plateau_force"]).all()
    assert np.isnan(found["depth"]).all()


def test_budget_of_the_modulus_is_that_of_the_table(session: Path) -> None:
    found = quantities(session, "nbr")
    table = result(session, "nbr", "tests")
    for i in range(len(DEPTHS)):
        made = found[f"relaxed reduced modulus, test {i + 1}"]
        budget = linear_budget(made.model, made.inputs)
        assert budget.value == pytest.approx(float(table["reduced_modulus"][i]), rel=1e-9)
        assert budget.u == pytest.approx(float(table["u_reduced_modulus"][i]), rel=0.05)
