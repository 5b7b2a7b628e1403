"""The campaign's plan: the experiments of the thesis, and a rig that a seed draws."""

import re
from collections import Counter
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from labpipe.errors import UsageError
from pipelines.rig import campaign
from pipelines.rig.samples import write_sample
from pipelines.rig.solids import ROOM


def test_the_campaign_holds_what_the_thesis_did(tmp_path: Path) -> None:
    parts = campaign._parts(tmp_path, datetime(2024, 5, 14), campaign.THESIS)
    count = Counter(name for names, _ in parts for name in names)
    assert count.pop("plate") == 16  # four materials, four heights
    assert set(count.values()) == {1}
    heights = ("1p5mm", "5mm", "7mm", "10mm")
    drops = {f"{material}_{height}" for material in campaign.POLYMERS for height in heights}
    films = {f"acrylic_{height}_film" for height in (*heights, "10mm_39C")}
    sweeps = {f"{material}_dma" for material in ("nbr", *campaign.POLYMERS)}
    others = {"acrylic_10mm_39C", "ptfe_film", "ptfe_static", "nbr_relaxation", "nbr_harmonic"}
    assert set(count) == drops | films | sweeps | others
    assert (campaign.THESIS.repeats, campaign.THESIS.plate_repeats) == (5, 3)


def test_by_a_seed_every_stated_value_is_off_the_truth_by_its_uncertainty() -> None:
    text = 'mass = "505.0 ± 0.5 g"\nheight = "1.5 ± 0.005 mm"\nnu = "0.490 ± 0.005"\nheight = "1.5 ± 0.005 mm"\n'
    text += 'mass = "505.0 ± 0.5 g"\ntemperature = "20.0 ± 0.5 degC"\nsynthetic = true\n'
    extents = [campaign.drawn(campaign.SMALL, seed) for seed in range(1, 401)]
    made = [campaign.misstated(text, extent, "session.toml") for extent in extents]
    assert made[0] == campaign.misstated(text, extents[0], "session.toml")
    values = np.array([[float(value) for value in re.findall(r'"([\d.]+) ±', one)] for one in made])
    mass, height, nu, other, again, temperature = values.T
    assert (mass == again).all()  # one measurement
    assert (height != other).all()  # by 3 µm, and the release scatters by 4 µm: together 5 µm
    assert nu.max() < 0.5
    for errors, u in ((mass - 505.0, 0.5), (height - 1.5, 0.003), (other - 1.5, 0.003), (temperature - ROOM, 0.5)):
        assert np.std(errors) == pytest.approx(u, rel=0.15)  # its own scatter is u/√800, 3.5 %
        assert abs(np.mean(errors)) < 4.0 * u / 20.0
    assert all(one.endswith('degC"\nsynthetic = true\n') for one in made)


def test_a_sample_that_no_seed_draws_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="thesis-small"):
        write_sample("core", tmp_path, seed=1)
