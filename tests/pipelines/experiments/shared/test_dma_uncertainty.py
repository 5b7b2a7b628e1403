"""What a DMA leaves uncertain reaches every prediction: its size, its growth outside the sweeps, its truth."""

import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from labpipe.materials import Prony
from labpipe.units import Quantity
from pipelines.experiments.dma.measured import readings, sweeps
from pipelines.experiments.dma.model import master_curve
from pipelines.experiments.dma.settings import Fit
from pipelines.experiments.shared.material_choice import resolve, variations
from pipelines.experiments.shared.settings import MaterialChoice
from pipelines.rig.campaign import SMALL
from pipelines.rig.dma import CAMPAIGN, Protocol, write_dma
from pipelines.rig.solids import ROOM, SOLIDS
from tests.pipelines.sweeps import settings_for

CHOICE = MaterialChoice(material_from="dma", temperature=Quantity(ROOM, 0.0, "degC"))
IMPACT = (1e-4, 1e-2)  # s


def measured(folder: Path, name: str, seed: int, protocol: Protocol = CAMPAIGN) -> xr.Dataset:
    """The master curve of one export of the rig."""
    solid = SOLIDS[name]
    export = write_dma(folder, f"{name}_{seed}", solid, protocol, seed)
    law, vertical = "arrhenius" if name == "peek" else "free", "rho_T" if solid.is_entropic else "linear"
    scale, fit = Quantity(1.0, protocol.u_scale, "1"), Fit(law=law, delay="on", vertical=vertical)
    settings = settings_for(name, export, scale=scale, fit=fit)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return master_curve(
            sweeps([readings(folder / export, settings=settings)], settings=settings), settings=settings
        )


def observed(solid: Prony, frequency: np.ndarray) -> np.ndarray:
    """Logarithms of storage modulus and loss factor."""
    modulus = solid.complex_modulus(2 * np.pi * frequency)
    return np.concatenate([np.log(modulus.real), np.log(modulus.imag / modulus.real)])


def uncertainty(fitted: xr.Dataset, times: tuple[float, float], frequency: np.ndarray, *left_out: str) -> np.ndarray:
    best = observed(resolve(CHOICE, None, fitted), frequency)
    parts = [
        (observed(v.solid, frequency) - best) * v.given.u / v.change
        for name, v in variations(CHOICE, None, fitted, times).items()
        if name not in left_out
    ]
    return np.sqrt(np.sum(np.square(parts), axis=0))


@pytest.fixture(scope="module")
def ptfe(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    return measured(tmp_path_factory.mktemp("dma"), "ptfe", 504)


def test_the_changes_together_are_as_large_as_the_bands_of_the_curve(ptfe: xr.Dataset) -> None:
    frequency = np.geomspace(30.0, 1000.0, 8)
    known = np.interp(
        np.log(frequency),
        np.log(ptfe["reduced_frequency"].values),
        (ptfe["u_master_storage"] / ptfe["master_storage"]).values,
    )
    found = uncertainty(ptfe, IMPACT, frequency, "DMA, specimen")[:8]
    np.testing.assert_allclose(found, known, rtol=0.25)


def test_outside_the_sweeps_a_prediction_widens(ptfe: xr.Dataset) -> None:
    fastest = float(ptfe["reduced_frequency"].max())
    slowest = float(ptfe["reduced_frequency"].min())
    inside, beyond = (uncertainty(ptfe, (t, t), np.array([1 / (2 * np.pi * t)]))[0] for t in (1e-3, 1e-4 / fastest))
    assert beyond > 3 * inside
    assert "DMA, faster than its sweeps" not in variations(CHOICE, None, ptfe, IMPACT)
    assert "DMA, slower than its sweeps" in variations(CHOICE, None, ptfe, (1e-3, 100 / slowest))


@pytest.mark.nightly
@pytest.mark.parametrize("name", sorted(SOLIDS))
def test_deviations_from_the_truth_are_those_that_are_stated(tmp_path: Path, name: str) -> None:
    frequency = np.array([50.0, 160.0, 500.0])
    true = SOLIDS[name].at(ROOM).modulus(frequency)
    known = np.concatenate([np.log(true.real), np.log(true.imag / true.real)])
    z = []
    for seed in range(700, 712):
        fitted = measured(tmp_path, name, seed)
        z.append((observed(resolve(CHOICE, None, fitted), frequency) - known) / uncertainty(fitted, IMPACT, frequency))
    # twelve exports: neighbouring frequencies say nearly the same, so about thirty independent values
    assert 0.65 < np.sqrt(np.mean(np.square(z))) < 1.4


def test_weights_past_the_slow_end_are_not_traded_for_the_relaxed_modulus(tmp_path: Path) -> None:
    """In these sweeps the fit's weights rise past the slow end, where storage alone does not tell them from it."""
    fitted = measured(tmp_path, "ptfe", 50_012, SMALL.dma)
    held = 2855.0  # s
    frequency = np.array([1 / (2 * np.pi * held)])
    known = np.sqrt(np.sum(fitted["mode_storage"].interp(mode_frequency=frequency).values ** 2))
    found = uncertainty(fitted, (held, held), frequency, "DMA, specimen")[0]
    assert found == pytest.approx(known, rel=0.1)
