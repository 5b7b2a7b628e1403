"""The campaign's plan: the experiments of the thesis, and a rig that a seed draws."""

from collections import Counter
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from labpipe.errors import UsageError
from pipelines.rig import campaign
from pipelines.rig.samples import write_sample


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


def test_a_seed_draws_the_rig_within_what_the_session_states() -> None:
    one, again, other = (campaign.drawn(campaign.SMALL, seed) for seed in (1, 1, 2))
    assert one == again != other
    drawn = [campaign.drawn(campaign.SMALL, seed) for seed in range(400)]
    masses = np.array([extent.rig.mass for extent in drawn]) - 0.505
    sizes = np.array([extent.under.pixel_size for extent in drawn]) / campaign.SMALL.under.pixel_size - 1.0
    for errors, u in ((masses, 0.5e-3), (sizes, np.hypot(1 / 461, 0.0005 / 2))):
        assert np.std(errors) == pytest.approx(u, rel=0.15)  # its own scatter is u/√800, 3.5 %
        assert abs(np.mean(errors)) < 4.0 * u / 20.0


def test_a_sample_that_no_seed_draws_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="thesis-small"):
        write_sample("core", tmp_path, seed=1)
