"""Harmonic indentation: hold, loops, work, eq. (2.31) and detachment against the rig's truth."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import xarray as xr

from labpipe import contact, materials
from pipelines.experiments.harmonic import comparison, measured as harmonic, model
from pipelines.experiments.shared import punch_model
from pipelines.rig.indentations import TESTER, Harmonic, Specimen, oscillation_section, write_harmonic
from pipelines.rig.session_text import cell_record
from pipelines.session import result
from tests.pipelines.sessions import begun, page_of, processed, settings_of, truth
from tests.pipelines.small import START

PROTOCOL = Harmonic(hold=5.0, frequencies=(1.0, 2.0), cycles=6)


def write(folder: Path, protocol: Harmonic, seed: int, **changes: Any) -> Path:
    specimen = Specimen(materials.load("nbr"))
    write_harmonic(folder, "nbr", specimen, protocol, replace(TESTER, **changes), seed, START)
    return begun(folder, oscillation_section("nbr", specimen) + "elements = 512\n", load_cell=cell_record())


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return processed(write(tmp_path_factory.mktemp("harmonic"), PROTOCOL, 31))


def stage(session: Path, name: str) -> xr.Dataset:
    return result(session, "nbr", name)


def test_work_and_stiffness_are_the_true_ones(session: Path) -> None:
    found = stage(session, "oscillations")
    for i, row in enumerate(truth(session, "nbr")["oscillations"]):
        for name in ("storage_stiffness", "loss_stiffness", "work_per_cycle"):
            gap = float(found[name][i]) - row[name]
            assert abs(gap) < 3 * float(found[f"u_{name}"][i]), name


def test_rows_know_what_a_wrong_delay_does_to_them(session: Path) -> None:
    loads, known, made = (stage(session, name) for name in ("loads", "oscillations", "model"))
    chosen = settings_of(session, "nbr")
    longer, u = json.loads(loads.attrs["filter_delay"])
    late = harmonic.oscillations(loads.assign_attrs(filter_delay=json.dumps([longer + 2e-4, u])), settings=chosen)
    laid = comparison.comparison(loads, known, made, settings=chosen)
    found = {(r.quantity, r.condition): r.slopes for r in comparison.rows(laid, known, made)}
    for i, frequency in enumerate(known["frequency"].values):
        for title, name in (
            ("storage stiffness", "storage_stiffness"),
            ("dissipated work per cycle", "work_per_cycle"),
        ):
            slope = found[title, f"{frequency:.3g} Hz"][comparison.DELAY]
            assert slope * 2e-4 == pytest.approx(float(late[name][i] - known[name][i]), rel=0.03)


def test_the_work_of_the_theory_is_that_of_the_equation(session: Path) -> None:
    """Eq. (2.31) with the fitted amplitude at the mean indentation; a few per cent above loops."""
    found, table = stage(session, "theory"), stage(session, "oscillations")
    rubber = materials.load("nbr")
    for i in range(found.sizes["oscillation"]):
        known = contact.dissipated_work(
            rubber,
            float(table["frequency"][i]),
            float(table["amplitude"][i]),
            float(table["mean_position"][i] - table["contact_position"]),
            2e-3,
            8e-3,
            18e-3,
        )
        assert float(found["dissipated_work"][i]) == pytest.approx(float(known), rel=1e-12)
    gap = found["dissipated_work"].values / table["work_per_cycle"].values - 1.0
    assert np.abs(gap).max() < 0.04


def test_where_the_theory_does_not_apply_it_says_so_and_nothing_fails(session: Path) -> None:
    given = settings_of(session, "nbr")
    wide = msgspec.structs.replace(given.punch, radius=given.punch.radius._replace(value=20e-3))
    parts = (stage(session, name) for name in ("oscillations", "loops"))
    found = model.theory(*parts, None, None, settings=msgspec.structs.replace(given, punch=wide))
    assert "do not apply: an approach" in found.attrs["absent"]


def test_the_model_of_the_right_material_agrees_and_contact_is_kept(session: Path) -> None:
    assert float(stage(session, "comparison")["nrmse"].max()) < 0.015
    assert (stage(session, "loops")["contact_loss"] == 0).all()
    assert (stage(session, "theory")["tapping_amplitude"] > 4 * PROTOCOL.amplitude).all()


def modelled(session: Path, chosen: Any) -> xr.Dataset:
    loads, table = stage(session, "loads"), stage(session, "oscillations")
    made = model.model(loads, table, None, None, settings=chosen)
    return comparison.comparison(loads, table, made, settings=chosen)


def test_a_material_a_tenth_too_stiff_shows(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(punch_model, "resolve", lambda *_: materials.load("nbr").scaled(1.1))
    assert float(modelled(session, settings_of(session, "nbr"))["nrmse"].min()) > 0.2


@pytest.mark.slow
def test_detachment_is_detected_as_long_as_it_lasts(tmp_path: Path) -> None:
    """An amplitude above the mean indentation: the punch leaves the rubber in every cycle."""
    processed(write(tmp_path, replace(PROTOCOL, mean=30e-6, amplitude=40e-6, frequencies=(1.0,)), 32))
    lost = float(stage(tmp_path, "loops")["contact_loss"][0])
    assert lost == pytest.approx(truth(tmp_path, "nbr")["oscillations"][0]["contact_loss"], abs=0.05)
    assert lost > 0.2
    assert float(stage(tmp_path, "comparison")["nrmse"].max()) < 0.02
    assert float(stage(tmp_path, "theory")["tapping_amplitude"][0]) < 40e-6
    page = page_of(tmp_path, "nbr")
    assert "contact is lost in part of the cycle at 0.996 Hz" in page
    assert "beyond the tapping front" in page


def test_moduli_by_fourier_components_are_those_of_the_fit_and_of_the_material(session: Path) -> None:
    found, table, rubber = stage(session, "theory"), stage(session, "oscillations"), materials.load("nbr")
    true = rubber.complex_modulus(2 * np.pi * table["frequency"].values)
    for part, exact in (("storage", true.real), ("loss", true.imag)):
        fitted, fourier = found[f"{part}_modulus"], found[f"fourier_{part}_modulus"]
        np.testing.assert_allclose(fourier, fitted, rtol=0.01)
        assert (np.abs(fourier / exact - 1.0) < 0.04).all()  # of a cosine tip, as the work of eq. (2.31)
    np.testing.assert_allclose(table["position_harmonic_2"], TESTER.second_harmonic, rtol=0.01)


def test_harmonics_of_a_force_that_tops_out_are_measured() -> None:
    time, cycles = np.arange(0.0, 10.0, 0.01), np.arange(2.0, 8.0)[:, None]
    wave = np.sin(2 * np.pi * time)
    lines, u = harmonic._fourier(time, 3.0 + 2.0 * wave + 0.1 * wave**2 + 0.01 * time, cycles, 1.0)
    assert abs(lines[0]) == pytest.approx(2.0, rel=1e-3)
    assert abs(lines[1]) == pytest.approx(0.05, rel=0.01)  # sin^2 = (1 - cos 2x) / 2
    assert (u < 1e-6).all()
