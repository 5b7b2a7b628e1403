"""Mistakes with rheometer exports are named; clean exports and strange polymers are believed."""

import warnings

import msgspec
import numpy as np
import pytest

from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.dma import checks, measured, model
from pipelines.experiments.dma._checked_sweeps import Export, isothermal_sweeps, trusted_rows
from pipelines.experiments.dma._specimen_checks import slipped_specimen
from pipelines.experiments.dma.settings import Dma
from pipelines.experiments.shared.judgements import believed
from pipelines.process import process
from pipelines.rig.dma import Protocol, write_dma
from pipelines.rig.session_text import dma_section, session_head
from pipelines.rig.solids import SOLIDS
from pipelines.session import verdict

SMALL = Protocol(
    temperatures=(-40.0, -20.0, 0.0, 20.0, 40.0),
    frequencies=tuple(np.geomspace(10.0, 0.1, 9).tolist()),
    ramp=(0.0, 5.0),
)
CONTEXT = Context("x", "dma", "", "", "", True)


def settings_for(name, count=1, **changes):
    solid = SOLIDS[name]
    table = Dma(
        kind="dma",
        rheometer=[f"dma/{i}.csv" for i in range(count)],
        mode=solid.mode,
        nu=Quantity(solid.nu, 0.0, "1"),
        T_ref=Quantity(min(solid.T_ref, 40.0), 0.0, "degC"),  # within these few sweeps
    )
    return msgspec.structs.replace(table, **changes)


def written(folder, name, seed=3):
    export = write_dma(folder, name, SOLIDS[name], SMALL, seed)
    return measured.readings(folder / export, settings=settings_for(name))


@pytest.fixture(scope="module")
def exports(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dma")
    return {name: written(folder, name) for name in SOLIDS}


@pytest.fixture
def acrylic(exports):
    return exports["acrylic"].copy(deep=True)


def judged(datasets, name="acrylic", curve=None, **changes):
    settings = settings_for(name, len(datasets), **changes)
    return believed(checks.judgement(datasets, None, curve, settings=settings, context=CONTEXT))


def finding(found, check):
    return next(c for c in found.checks if c.level and c.name == check)


@pytest.mark.parametrize("name", sorted(SOLIDS))
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_clean_export_is_believed(tmp_path, name, seed):
    found = judged([written(tmp_path, name, seed)], name)
    assert found.believable == "yes", found.findings
    assert 6 < found.n_made <= 12


def test_exchanged_columns_are_named_from_the_loss_factor_and_from_causality(acrylic):
    storage, loss = acrylic["storage_modulus"].values.copy(), acrylic["loss_modulus"].values.copy()
    acrylic["storage_modulus"].values[:], acrylic["loss_modulus"].values[:] = loss, storage
    found = judged([acrylic])
    assert finding(found, "loss factor").level == "impossible"
    assert "exchanged" in finding(found, "loss factor").cause
    assert finding(found, "storage and loss belong together").level == "impossible"
    alone = judged([acrylic.drop_vars("loss_factor")])
    assert alone.believable == "impossible"
    assert "exchanged" in alone.causes[0]


def test_megapascals_as_pascals_are_named_by_the_stress(acrylic):
    for column in ("storage_modulus", "loss_modulus"):
        acrylic[column].values[:] *= 1e-6
    found = judged([acrylic])
    assert finding(found, "stress over strain").level == "impossible"
    assert "MPa stand as Pa" in finding(found, "stress over strain").cause
    plain = judged([acrylic.drop_vars(["stress", "strain"])])
    assert plain.believable == "doubtful"
    assert "MPa stand as Pa" in plain.causes[0]


@pytest.mark.parametrize("column", ["storage_modulus", "loss_modulus"])
@pytest.mark.parametrize("point", [0, 4, 8])
def test_one_value_a_thousand_times_too_large_is_found_with_its_row(acrylic, column, point):
    row = 9 + point
    acrylic[column].values[row] *= 1e3
    found = finding(judged([acrylic]), "single values")
    assert found.level == "impossible"
    assert f"interval 2, point {point + 1}" in found.cause
    assert "1000" in found.cause
    assert "factor" in finding(judged([acrylic]), "loss factor").cause


def fitted(data, name):
    settings = settings_for(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return model.master_curve(measured.gathered([data], settings=settings), settings=settings)


@pytest.mark.parametrize(("name", "interval"), [("acrylic", 3), ("acrylic", 9), ("ptfe", 3), ("ptfe", 9), ("nbr", 3)])
def test_an_interval_that_is_30_kelvin_too_high_is_named(tmp_path, name, interval):
    export = write_dma(tmp_path, name, SOLIDS[name], Protocol(), 3)
    data = measured.readings(tmp_path / export, settings=settings_for(name))
    data["temperature"].values[11 * interval - 11 : 11 * interval] += 30.0
    found = finding(judged([data], name), "order with temperature")
    assert found.level in ("impossible", "doubtful")
    assert f"interval {interval} is probably" in found.cause
    assert "too high" in found.cause


def test_shifts_that_rise_with_temperature_are_impossible(exports):
    data = exports["ptfe"]
    curve = fitted(data, "ptfe")
    assert judged([data], "ptfe", curve).believable == "yes"
    curve["log10_aT"].values[2] += 3.0
    assert finding(judged([data], "ptfe", curve), "order of the shifts").level == "impossible"


@pytest.mark.parametrize(("unit", "level"), [("K", "impossible"), ("°F", "doubtful")])
def test_another_unit_of_temperature_is_named(acrylic, unit, level):
    T = acrylic["temperature"].values
    T[:] = T + 273.15 if unit == "K" else T * 1.8 + 32
    found = finding(judged([acrylic]), "temperatures")
    assert found.level == level
    assert f"temperatures are in {unit}" in found.cause


def test_a_constant_temperature_is_impossible(acrylic):
    acrylic["temperature"].values[:] = 20.0
    found = finding(judged([acrylic]), "temperature is measured")
    assert found.level == "impossible"
    assert "constant" in found.cause


def test_hertz_under_radians_per_second_are_seen_by_the_time_of_a_reading(acrylic):
    for column in ("frequency", "angular_frequency"):
        acrylic[column].values[:] /= 2 * np.pi
    found = finding(judged([acrylic]), "frequency")
    assert found.level == "doubtful"
    assert "Hz under rad/s" in found.cause


def test_radians_per_second_under_hertz_are_seen_by_set_frequencies(acrylic):
    for column in ("frequency", "angular_frequency"):
        acrylic[column].values[:] *= 2 * np.pi
    acrylic.attrs["derived"] = "angular_frequency"
    assert "rad/s under Hz" in finding(judged([acrylic]), "frequency").cause


def test_the_same_values_under_two_names_are_a_copy(acrylic):
    found = finding(judged([acrylic, acrylic.copy(deep=True)]), "same values twice")
    assert found.level == "doubtful"
    assert (found.file, "copy" in found.cause) == ("dma/1.csv", True)


def test_a_second_file_of_another_polymer_is_impossible_and_a_repeat_is_not(exports, tmp_path):
    found = judged([exports["ptfe"], exports["peek"]], "ptfe")
    assert "another material" in finding(found, "files of one specimen").cause
    far = judged([exports["peek"], exports["nbr"]], "peek")
    assert finding(far, "files of one specimen").level == "impossible"
    assert judged([exports["ptfe"], written(tmp_path, "ptfe", 8)], "ptfe").believable == "yes"


@pytest.mark.parametrize(("nu", "level"), [(0.049, "doubtful"), (0.3, None), (0.5, None)])
def test_an_implausible_poisson_ratio_is_doubtful(acrylic, nu, level):
    found = judged([acrylic], nu=Quantity(nu, 0.0, "1"))
    levels = {c.name: c.level for c in found.checks if c.level}
    assert levels.get("Poisson's ratio") == level
    assert ("0.49" in " ".join(found.causes)) == (level is not None)


@pytest.mark.parametrize(("name", "mode"), [("acrylic", "tension"), ("nbr", "torsion")])
def test_torsion_for_tension_names_the_mode(exports, name, mode):
    found = finding(judged([exports[name]], name, mode=mode), "mode of loading")
    assert found.level == "doubtful"
    assert (found.setting, f"not {mode}" in found.cause) == ("mode", True)


def test_a_session_says_its_verdict_and_its_page_opens_with_it(tmp_path):
    export = write_dma(tmp_path, "ptfe", SOLIDS["ptfe"], SMALL, 3)
    text = session_head("one material") + dma_section("ptfe", export, SOLIDS["ptfe"])
    wrong = text.replace('nu = "0.46 ± 0.01"', 'nu = "0.046"')
    assert wrong != text
    (tmp_path / "session.toml").write_text(wrong, "utf-8")
    process(tmp_path, jobs=0)
    (one,) = verdict(tmp_path, jobs=0).experiments
    assert (one.believable, one.model) == ("doubtful", "none")
    line = wrong.splitlines().index('nu = "0.046"') + 1
    assert (one.findings[0].file, one.findings[0].line) == ("session.toml", line)
    page = (tmp_path / "labpipe/reports/ptfe.html").read_text("utf-8")
    assert page.index("Verdict") < page.index("Summary")
    assert "Doubtful: nu = 0.046" in page


def sweeps_of(folder, name, modulus):
    """A table of eight sweeps of a complex modulus at reduced angular frequencies."""
    frequency, rng = np.logspace(-1, 2, 16), np.random.default_rng(0)
    lines = ["f,E',E'',T", "Hz,Pa,Pa,C"]
    for T in np.arange(-20.0, 51.0, 10.0):
        a = -7 * (T - 25) / (140 + T - 25)
        found = modulus(2 * np.pi * frequency * 10**a) * (1 + 0.005 * rng.standard_normal(frequency.size))
        lines += [f"{f:.6g},{E.real:.6g},{E.imag:.6g},{T}" for f, E in zip(frequency, found, strict=True)]
    (folder / name).write_text("\n".join(lines) + "\n", "utf-8")
    settings = Dma(kind="dma", rheometer=[name], mode="tension", nu=Quantity(0.45, 0.0, "1"))
    data = measured.readings(folder / name, settings=settings)
    export = Export(name, data, trusted_rows(data))
    return export, list(isothermal_sweeps(export, settings))


def fractions(relaxed, *elements):
    def modulus(omega):
        return relaxed + sum(E * (1 + (1j * omega * tau) ** -b) ** -1 for E, tau, b in elements)

    return modulus


@pytest.mark.parametrize(
    "modulus",
    [
        fractions(0.0, (4e5, 1e-2, 0.95)),
        fractions(6e6, (1.5e9, 1e-4, 0.5)),
        fractions(5e6, (1e9, 3e-6, 0.6), (8e6, 1e-1, 0.7)),
    ],
    ids=["melt", "one loss peak", "two loss peaks"],
)
def test_no_specimen_is_said_to_slip_where_the_loss_factor_turns(tmp_path, modulus):
    export, sweeps = sweeps_of(tmp_path, "turning.csv", modulus)
    assert slipped_specimen(export, sweeps).level is None
    assert sweeps[0].place == "turning.csv, sweep at -20.0 °C, interval 1"
