"""Plate vibration: the ringing against the rig's truth, and the plate in the model of a drop."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from labpipe import materials
from labpipe.uncertainty import linear_budget
from pipelines.experiments.plate_vibration.comparison import amplitudes
from pipelines.rig.campaign import SMALL
from pipelines.rig.dma import sweeps
from pipelines.rig.drops import DropRig, write_drops
from pipelines.rig.plate import PLATE, PLATE_RIG
from pipelines.rig.session_text import drop_section, laser_record, plate_laser_record
from pipelines.session import open_session, process, result
from tests.pipelines.budgets import quantities
from tests.pipelines.sessions import begun, copied, processed, settings_of, truth
from tests.pipelines.small import START, write_plate

NAMES = ("acrylic", "ptfe")
PTFE = "laser_plate/plate_ptfe_5mm"
RIGID = 'plate = { mass = "3 kg", frequency = "1 Hz", damping_ratio = 0.1 }\n'


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The plate under two materials from 5 mm, and acrylic dropped on that plate."""
    folder = tmp_path_factory.mktemp("plate")
    text = write_plate(folder, replace(PLATE_RIG, duration=0.12), NAMES, (5e-3,), 2, START)
    rig = DropRig(duration=0.3, floor=PLATE)
    recordings = write_drops(folder, "drop", rig, materials.load("acrylic"), 5e-3, 1, 5, START)
    text += drop_section("drop", recordings, 5e-3, "acrylic", 'plate_from = "plate"\n')
    text += drop_section("rigid", recordings, 5e-3, "acrylic") + sweeps(folder, *NAMES, protocol=SMALL.dma)
    processed(begun(folder, text, laser=laser_record(), laser_plate=plate_laser_record()), only=["plate"])
    return processed(folder, ["comparison"], ["drop", "rigid"])  # of these no page is looked at


@pytest.mark.filterwarnings("ignore:the record ends before the body is at rest")
def test_every_ringing_is_the_true_one_within_its_uncertainty(session: Path) -> None:
    for name in NAMES:
        for repeat in (1, 2):
            stem = f"plate_{name}_5mm_{repeat}"
            found = result(session, "plate", "ringing", f"laser_plate/{stem}.csv")
            known = truth(session, stem)
            for quantity in ("natural_frequency", "damping_ratio", "blow_time"):
                gap = float(found[quantity]) - known[quantity]
                assert abs(gap) < 3.5 * float(found[f"u_{quantity}"]), quantity
            shared = found.attrs["u_systematic_relative"] * known["amplitude"]
            u = np.hypot(float(found["u_amplitude"]), shared)
            assert abs(float(found["amplitude"]) - known["amplitude"]) < 3.5 * u


def test_frequency_is_the_plate_s_and_the_modal_mass_the_true_one(session: Path) -> None:
    table, plate = result(session, "plate", "table"), result(session, "plate", "plate")
    assert float(table["probability_natural_frequency"]) > 0.01
    amplitude = dict(zip(table["material"].values, table["amplitude"].values, strict=True))
    assert amplitude["acrylic"] > 1.1 * amplitude["ptfe"]  # it returns more momentum
    for name, true in (("mass", 30.0), ("frequency", 180.0), ("damping_ratio", 0.03)):
        assert abs(float(plate[name]) - true) < 3.5 * float(plate[f"u_{name}"]), name
    assert float(plate["u_mass"]) < 0.01 * float(plate["mass"])


def test_two_drops_that_predict_each_other_differ_by_as_much_in_units_of_u(session: Path) -> None:
    """They are one comparison: an amplitude 14 % off is no more than that."""
    table, plate = result(session, "plate", "table"), result(session, "plate", "plate")
    settings = settings_of(session, "plate")
    by = np.array([1.14, 1.0])
    other = table.assign(amplitude=table["amplitude"] * by), plate.assign(modal_mass=plate["modal_mass"] / by)
    first, second = (one.deviation for one in amplitudes(*other, settings) if one is not None)
    assert first == pytest.approx(-second, rel=1e-9)
    assert abs(first) > 2.0


def test_a_drop_on_a_plate_needs_the_plate_in_its_model(session: Path) -> None:
    with_plate, rigid = (result(session, name, "comparison") for name in ("drop", "rigid"))
    assert float(with_plate["nrmse"]) < 0.01
    assert float(rigid["nrmse"]) > 3 * float(with_plate["nrmse"])
    for made, is_right in ((with_plate, True), (rigid, False)):
        gap = np.abs(made["restitution_difference"].values[0])
        assert (gap < 3 * made["u_restitution_difference"].values[0]) == is_right
    kept = json.loads(result(session, "drop", "model").attrs["plate"])
    assert kept["frequency"] == pytest.approx(180.0, rel=1e-3)


def test_without_a_sphere_there_is_no_mass_and_a_drop_says_so(session: Path, tmp_path: Path) -> None:
    sphere = '\n[experiments.plate.sphere]\nradius = "9.525 ± 0.005 mm"\nmass = "505.0 ± 0.5 g"\n'
    folder = copied(session, tmp_path, sphere, "")
    outcome = process(folder, only=["plate", "drop"], jobs=0)
    told = {o.task.experiment: o.message for o in outcome.failures if o.task.stage == "model"}
    assert "name the sphere" in told["plate"]
    assert "no modal mass" in told["drop"]
    assert np.isfinite(float(result(folder, "plate", "plate")["frequency"]))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('plate_from = "plate"\n', 'plate_from = "plate"\n' + RIGID, "not both"),
        (f"{PTFE}_1.csv", "laser_plate/plate_acrylic_5mm_1.csv", "more than one"),
        (f"{PTFE}_1.csv", f"{PTFE}_7.csv", "no file"),
        ('"ptfe_dma"', '"ptfe_drop"', r"drops no. 2.*no experiment"),
    ],
)
def test_mistakes_in_the_session_are_named(session: Path, tmp_path: Path, old: str, new: str, says: str) -> None:
    folder = copied(session, tmp_path, old, new, ignored="labpipe")
    said = [problem for problems in open_session(folder).waiting.values() for problem in problems]
    assert any(re.search(says, problem) for problem in said), said


def test_the_clock_stands_in_the_natural_frequency(session: Path) -> None:
    found = quantities(session, "plate")
    table = result(session, "plate", "table")
    made = found["natural frequency"]
    budget = linear_budget(made.model, made.inputs)
    assert budget.u == pytest.approx(float(table["u_plate_natural_frequency"]), rel=1e-6)
    assert budget.u > 5e-5 * float(table["plate_natural_frequency"])
    mass = found["modal mass"]
    whole = float(result(session, "plate", "plate")["u_mass"])
    assert linear_budget(mass.model, mass.inputs).u == pytest.approx(whole, rel=1e-3)
