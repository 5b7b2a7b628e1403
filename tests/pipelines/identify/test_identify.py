import contextlib
import html
import io
import json
import re
import shutil
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import msgspec
import numpy as np
import pytest

from labpipe import files, materials
from labpipe.errors import UsageError
from labpipe.identification import Bounces, moduli
from labpipe.units import Quantity
from pipelines.cli import main
from pipelines.experiments import KINDS
from pipelines.experiments.shared.material_evidence import CONTACT_MODULUS, of_drop
from pipelines.experiments.shared.settings import Plate
from pipelines.identify import identify_materials, material_name
from pipelines.identify._page import SHAPE
from pipelines.rig.indentations import TESTER, Relaxation, Specimen, relaxation_section, write_relaxation
from pipelines.rig.session_text import cell_record
from pipelines.session import derive, opened, plan
from tests.pipelines.sessions import begun

DROP = KINDS["ball_drop"].evidence


@pytest.fixture(scope="module")
def rubber(pristine_session: Path, tmp_path_factory: pytest.TempPathFactory):
    """What the harmonic indentation of the small session tells, by the command line."""
    folder = tmp_path_factory.mktemp("identified") / "session"
    shutil.copytree(pristine_session, folder)
    (folder / "laser/drop_2.csv").unlink()  # what is lost elsewhere is of no concern here
    said = io.StringIO()
    with pytest.raises(SystemExit) as left, contextlib.redirect_stdout(said):
        main(["identify", str(folder), "-e", "nbr", "--json"])
    assert left.value.code == 0
    files.write_text(folder / "said.json", said.getvalue())
    return folder


def test_indentation_finds_the_rigs_modulus_where_it_oscillated(rubber: Path) -> None:
    found = files.read_dataset(rubber / "labpipe/identify_nbr.nc")
    truth = materials.load("nbr").complex_modulus(2 * np.pi * found["frequency"].values)
    known = found["is_determined"].values == 1
    frequencies = found["frequency"].values[known]
    assert (
        float(found["lowest_frequency"]) <= frequencies.min() <= frequencies.max() <= float(found["highest_frequency"])
    )
    for name, exact in (("storage", truth.real), ("loss_factor", truth.imag / truth.real)):
        gap = np.log(found[name].values / exact) / found[f"u_ln_{name}"].values
        assert np.abs(gap[known]).max() < 3


def test_indentation_alone_does_not_claim_the_long_time_modulus(rubber: Path) -> None:
    found = files.read_dataset(rubber / "labpipe/identify_nbr.nc")
    assert str(found["verdict"].values[0]) == "bounded from above"
    assert float(found["high"][0]) > materials.load("nbr").E_relaxed
    page = (rubber / "labpipe/identify_nbr.html").read_text(encoding="utf-8")
    assert "bounded from above only" in page
    assert "thirty years" not in page  # nothing is said of times that were not measured
    assert page.index('id="chart-1"') < page.index('id="limits-of-the-result"')
    assert "Synthetic data" in page
    assert "Poisson&#39;s ratio was taken as exactly 0.5" in page
    assert {"nbr: storage stiffness", "nbr: loss stiffness"} <= set(re.findall(r"nbr: [a-z ]+", page))


def test_document_names_the_unknowns_with_verdicts_and_the_result_is_a_material_again(rubber: Path) -> None:
    (document,) = json.loads((rubber / "said.json").read_text(encoding="utf-8"))
    assert document["E_relaxed"]["verdict"] == "bounded from above"
    verdicts = {row["name"]: row["verdict"] for row in document["unknowns"]}
    assert verdicts["filter"] in {"determined by the data", "better known by the data", "known from the prior only"}
    assert document["frequency_range"][0] == pytest.approx(1.0, rel=0.02)
    found = files.read_dataset(rubber / "labpipe/identify_nbr.nc")
    solid = materials.Prony(float(found["E_relaxed"]), found["E"].values, found["rho"].values, nu=float(found["nu"]))
    made = solid.complex_modulus(2 * np.pi * found["frequency"].values).real
    # the curve is that of all structures of the spectrum, the series that of one
    assert (np.abs(np.log(made / found["storage"])) <= 3 * found["u_ln_storage"]).all()
    assert float(found["structure_probability"].sum()) == pytest.approx(1.0)


def test_what_the_data_tell_of_the_experiment_is_said_as_large_as_it_is(rubber: Path) -> None:
    found = files.read_dataset(rubber / "labpipe/identify_nbr.nc")
    page = html.unescape((rubber / "labpipe/identify_nbr.html").read_text(encoding="utf-8"))
    (silent,) = re.findall("Nothing new about ([^:<]*):", page) or [""]
    removed = {"determined by the data": (0.75, 1.0), "better known by the data": (0.0975, 0.75)}
    rows = zip(*(found[name].values for name in ("parameter_name", "verdict", "contraction")), strict=True)
    for name, verdict, share in list(rows)[1:]:
        least, most = removed.get(verdict, (-0.01, 0.0975))
        assert least <= share <= most, (name, verdict)
        if name.startswith(SHAPE):
            continue
        assert (name in silent.split(", ")) == (verdict == "known from the prior only"), name


def test_drop_becomes_evidence_without_the_scatter_of_its_heights(processed_session: Path) -> None:
    results = opened(processed_session)
    proof = derive(results, results.experiments["drop"], DROP, name="drop", impacts=2)
    evidence = proof.build(np.array([1e-3]))
    touch, duration = evidence.groups
    assert touch.name == "time of touch"
    assert touch.u.max() < 2e-5
    assert duration.values.min() > 5e-4
    names = {p.name for p in proof.unknowns}
    assert {"drop height", "drop trigger", "pulse shape"} <= names
    # what all durations share is in that unknown, not in the noise of each
    stated = results.result("drop", "repeats")["u_contact_duration"].values[: duration.u.size]
    assert np.allclose(duration.u**2 + evidence.model.shared**2, stated**2)
    # the true material predicts what was seen, within height and readings
    given = {p.name: p.mean for p in proof.unknowns}
    model = replace(evidence.model, rtol=1e-4)
    predicted = model.predict(materials.load("acrylic"), given, is_full=True)
    assert np.abs(predicted / evidence.values - 1).max() < 0.03


def test_uncertain_poissons_ratio_is_an_unknown_of_the_contact(processed_session: Path, tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    text = (Path(materials.__file__).parent / "library/acrylic.toml").read_text("utf-8")
    files.write_text(own, text.replace('value = "0.35"', 'value = "0.35 ± 0.01"'))
    settings = opened(processed_session).experiments["drop"].settings
    none, touch = np.full(2, np.nan), np.array([0.0, 0.02])
    seen = Bounces(touch, np.full(2, 1e-5), np.full(2, 1e-3), np.full(2, 1e-5), none, none)
    proof = of_drop("drop", settings, seen, {}, None, own, None)
    (ratio,) = (p for p in proof.unknowns if p.name == CONTACT_MODULUS)
    contact_modulus = [1 / (1 - nu**2) for nu in (0.35, 0.36)]
    assert ratio.sd == pytest.approx(contact_modulus[1] / contact_modulus[0] - 1, rel=0.05)
    model = proof.build(np.array([1e-3])).model
    solid, given = materials.load("acrylic"), {p.name: p.mean for p in proof.unknowns}
    stiffer = model.predict(solid, given | {CONTACT_MODULUS: 1.01})
    assert np.allclose(stiffer, model.predict(solid.scaled(1.01), given), rtol=1e-12)


@pytest.mark.slow
def test_relaxations_at_two_depths_are_one_material(tmp_path: Path) -> None:
    solid = materials.load("nbr")
    specimen = Specimen(solid)
    held = Relaxation((0.1e-3, 0.2e-3), 20.0)
    names = write_relaxation(tmp_path, "hold", specimen, held, TESTER, 5, datetime(2024, 5, 14))
    begun(tmp_path, relaxation_section("hold", names, specimen), load_cell=cell_record())
    (found,) = identify_materials(tmp_path)
    first, second = found.known.fit.problem.evidence[0].groups
    assert first.name != second.name
    curve = moduli(found.known, np.array([0.02, 0.1]))
    truth = solid.complex_modulus(2 * np.pi * curve.frequency)
    assert curve.is_determined.all()
    assert (np.abs(np.log(curve.storage / truth.real)) < 3 * curve.u_ln_storage).all()
    assert curve.u_ln_storage.max() < 0.02
    assert found.relaxed.low < solid.E_relaxed < found.relaxed.high


def test_drop_on_a_plate_is_told_by_the_plate(processed_session: Path) -> None:
    results = opened(processed_session)
    experiment = results.experiments["drop"]
    stated = Plate(
        mass=Quantity(30.0, 0.04, "kg"), frequency=Quantity(180.0, 0.1, "Hz"), damping_ratio=Quantity(0.03, 1e-4, "1")
    )
    settings = msgspec.structs.replace(experiment.settings, plate=stated)
    changed = replace(experiment, settings=settings)
    proof = derive(results, changed, DROP, name="drop", impacts=2)
    model = proof.build(np.array([1e-3])).model
    assert model.plate.frequency == 180.0
    assert model.names["plate"] == "mass of the plate"
    (mass,) = (p for p in proof.unknowns if p.name == "mass of the plate")
    assert (mass.mean, mass.sd) == (30.0, 0.04)


@pytest.mark.parametrize(
    ("experiment", "prior", "told"),
    [
        ("steel", None, "there is no experiment steel"),
        ("nbr", "dma", "there are: none"),
        ("nbr", "paper", 'no rheometer experiment "paper"; known are: none'),
    ],
)
def test_a_name_that_is_not_there_is_told(
    processed_session: Path, experiment: str, prior: str | None, told: str
) -> None:
    with pytest.raises(UsageError, match=told):
        identify_materials(processed_session, (experiment,), prior=prior)


def test_another_temperature_is_another_material(processed_session: Path) -> None:
    experiment = plan(processed_session).session.experiments["drop"]
    assert material_name(experiment) == "acrylic"
    sphere = msgspec.structs.replace(experiment.settings.sphere, temperature=Quantity(39, 0, "degC"))
    warm = msgspec.structs.replace(experiment.settings, sphere=sphere)
    assert material_name(replace(experiment, settings=warm)) == "acrylic at 39 °C"
