"""Growth is measured where it is, and nothing that can grow is forgotten."""

import numpy as np
import pytest

from pipelines.bench import scaling
from pipelines.bench.measure import Timing, peak_bytes


def test_the_exponent_leaves_out_what_every_call_costs() -> None:
    sizes = [1, 2, 4, 8]
    assert scaling.slope(sizes, [3.0 * n**1.5 for n in sizes]) == pytest.approx(1.5)
    # a constant hides the growth of small sizes; the smallest is not looked at
    assert scaling.slope([1, 100, 200], [10.0, 100.0, 200.0]) == pytest.approx(1.0)


@pytest.mark.slow
def test_memory_of_tracking_does_not_grow_with_the_images_kept() -> None:
    # shorter films do not fill what is kept of a film at a time
    short, long = (scaling._film_length(count) for count in (160, 320))
    short()
    per_frame = (peak_bytes(long) - peak_bytes(short)) / 160
    assert per_frame < 160 * 160 / 2  # half an image of 8 bit; its coefficients take four times as much as one


@pytest.mark.slow
def test_every_growth_gives_a_diagram_and_an_exponent() -> None:
    growth = scaling.Growth("toy", "terms", [4, 8, 16], scaling._terms)
    suite, summary = scaling._measure(growth, quick=True)
    assert [p.error for p in suite.points] == [4.0, 8.0, 16.0]
    assert np.isfinite(summary.error)
    lowest, highest = (max(0.0, summary.extra[name]) for name in ("lowest", "highest"))
    assert lowest <= summary.error <= highest
    assert summary.extra["to"] == 16


@pytest.mark.slow
def test_what_gets_quicker_with_size_does_not_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    def ever_faster(calls: dict[str, object], *_: object, **__: object) -> dict[str, Timing]:
        return {size: Timing(1.0 / int(size), 0.0, (1.0 / int(size),) * 2, None) for size in calls}

    monkeypatch.setattr(scaling, "paired", ever_faster)
    growth = scaling.Growth("toy", "terms", [4, 8, 16], lambda _: lambda: None)
    _, summary = scaling._measure(growth, quick=True)
    assert summary.error == 0.0
    assert summary.extra["at most linear"]
    assert summary.extra["lowest"] == pytest.approx(-1.0)


def test_a_slow_spell_does_not_make_a_linear_growth_steep() -> None:
    linear, disturbed = [1.0, 2.0, 4.0], [1.0, 2.0, 9.0]
    found = scaling.exponents([1, 2, 4], list(zip(linear, disturbed, linear, strict=True)))
    assert found[0] == pytest.approx(1.0)
    assert found[1] > 2.0
    assert sorted(found)[1] == pytest.approx(1.0)
