"""Mistakes with rheometer exports are named; clean exports and strange polymers are believed."""

from dataclasses import replace

import pytest

from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.dma import checks, measured
from pipelines.experiments.shared.judgements import believed
from pipelines.rig.dma import Protocol, write_dma
from pipelines.rig.solids import SOLIDS
from tests.pipelines.sweeps import FEW, settings_for

SMALL = replace(FEW, ramp=(0.0, 5.0))
CONTEXT = Context("x", "dma", "", "", "", True)


def stated(name, count=1, **changes):
    T_ref = Quantity(min(SOLIDS[name].T_ref, 40.0), 0.0, "degC")  # within these few sweeps
    return settings_for(name, *(f"dma/{i}.csv" for i in range(count)), T_ref=T_ref, **changes)


def written(folder, name, seed=3):
    export = write_dma(folder, name, SOLIDS[name], SMALL, seed)
    return measured.readings(folder / export, settings=stated(name))


@pytest.fixture(scope="module")
def exports(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dma")
    return {name: written(folder, name) for name in SOLIDS}


@pytest.fixture
def acrylic(exports):
    return exports["acrylic"].copy(deep=True)


def judged(datasets, name="acrylic", curve=None, **changes):
    settings = stated(name, len(datasets), **changes)
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


@pytest.mark.parametrize(("name", "interval"), [("acrylic", 3), ("acrylic", 9), ("ptfe", 3), ("ptfe", 9), ("nbr", 3)])
def test_an_interval_that_is_30_kelvin_too_high_is_named(tmp_path, name, interval):
    export = write_dma(tmp_path, name, SOLIDS[name], Protocol(), 3)
    data = measured.readings(tmp_path / export, settings=stated(name))
    data["temperature"].values[11 * interval - 11 : 11 * interval] += 30.0
    found = finding(judged([data], name), "order with temperature")
    assert found.level in ("impossible", "doubtful")
    assert f"interval {interval} is probably" in found.cause
    assert "too high" in found.cause
