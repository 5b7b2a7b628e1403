import numpy as np
import pytest

from pipelines.bench import identification


@pytest.mark.slow
def test_quick_run_covers_the_truth_and_reaches_the_bound(monkeypatch) -> None:
    monkeypatch.setattr(identification, "_FEW_HOLDS", 8)
    suite = identification.run(quick=True)
    *moduli, verdict = suite.points
    apart = [p for p in moduli if "symmetric" in p.setting or "skewed" in p.setting]
    assert {p.extra["truths"] for p in apart} == {4}
    assert all(0.2 < point.error < 1.8 for point in apart)
    assert np.mean([point.extra["coverage (%)"] for point in apart]) >= 90.0
    # over several structures an answer may be a little surer than the bound of one
    assert all(0.9 < p.extra["uncertainty over bound, median"] < 2.0 for p in moduli)
    assert verdict.extra["limits hold the truth (%)"] >= 90.0


def test_truths_are_admissible_and_differ() -> None:
    solids = [identification.random_solid(seed, is_rubber=False) for seed in range(5)]
    loss = [float(s.modulus(1e3).imag / s.modulus(1e3).real) for s in solids]
    assert min(loss) > 0.003
    assert max(loss) < 0.1
    assert len({round(s.relaxed) for s in solids}) == 5
