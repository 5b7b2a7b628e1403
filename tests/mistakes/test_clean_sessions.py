"""Clean sessions of all kinds are believed, no model differs, and contacts and deviations are as often right as stated.

All that a session states lies off the truth by its stated uncertainty. At most 2 % of the experiments may be doubtful.
"""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from pipelines.experiments import KINDS
from pipelines.rig import sample
from pipelines.session import derive, opened, verdict
from tests.pipelines.deviations import write_specimens


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore")
def test_clean_sessions_are_believed(tmp_path: Path) -> None:
    found = []
    for seed in range(20):
        folder = tmp_path / str(seed)
        write_specimens(folder, seed)
        found += [(seed, one) for one in verdict(folder, ("judgement",), jobs=0).experiments]
    assert len(found) > 120
    assert [each for each in found if each[1].believable == "impossible" or each[1].model == "differs"] == []
    assert len(wrong := [each for each in found if each[1].believable != "yes"]) <= 0.02 * len(found), wrong


@pytest.mark.parametrize(
    ("name", "seeds"),
    [
        pytest.param("thesis-small", (101,), marks=pytest.mark.slow),
        pytest.param("thesis-small", (102, 103), marks=pytest.mark.nightly),
        pytest.param("thesis", (101, 102, 103), marks=pytest.mark.nightly),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_campaigns_are_believed_and_agree(name: str, seeds: Sequence[int], tmp_path: Path) -> None:
    p, radii, root_mean_squares = list[float](), list[float](), list[float]()
    for seed in seeds:
        sample(name, folder := tmp_path / str(seed), seed=seed)
        found = verdict(folder, ("judgement",)).experiments
        assert [one for one in found if one.believable != "yes" or one.model == "differs"] == [], seed
        results = opened(folder)
        deviations = list[float]()
        for experiment in results.experiments.values():
            p.append(float(results.result(experiment.name, "judgement")["p"]))
            rows = KINDS[experiment.kind].rows
            deviations += [r.deviation for r in (derive(results, experiment, rows) if rows else ()) if r.deviation]
            if experiment.kind == "contact_area":
                radii += _radii(folder, experiment.name, results.result(experiment.name, "radius"))
        root_mean_squares.append(float(np.sqrt(np.mean(np.square(deviations)))))
    known = np.array(p)[np.isfinite(p)]
    assert np.sum(known < 0.05) <= stats.binom.ppf(0.999, known.size, 0.05)
    assert stats.binom.ppf(0.001, len(radii), 0.95) <= np.sum(np.abs(radii) < 1.96)
    # the same sweeps, sphere and laser stand behind the deviations of one campaign: few are independent
    assert 0.5 < np.mean(root_mean_squares) < 1.5, root_mean_squares


def _radii(folder: Path, name: str, found: xr.Dataset) -> Sequence[float]:
    """Return errors of contact radii over their uncertainty; a frame that is wrongly decided fails."""
    known = json.loads((folder / f"truth/{name}_under.json").read_text("utf-8"))
    truth, seen = np.array(known["contact_radius"])[found["frame"].values], found["in_contact"].values.astype(bool)
    assert not (seen & (truth <= 0.0)).any(), name
    assert not (~seen & (truth > 1.3 * found.attrs["least_radius"])).any(), name
    u = np.hypot(found["u_radius"].values, found["radius_systematic"].values)
    u = np.hypot(u, known["resolution"] / np.sqrt(3.0))  # the truth itself is not known better
    kept = seen & (truth > found.attrs["least_radius"]) & np.isfinite(found["radius"].values)
    ratios: list[float] = ((found["radius"].values - truth) / u)[kept].tolist()
    return ratios
