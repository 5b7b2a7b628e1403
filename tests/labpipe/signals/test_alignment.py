import numpy as np
import pytest
import xarray as xr

from labpipe.errors import InputError
from labpipe.signals import combine_repeats


def repeat(start, seed, scale=1.0, interval=1e-3, duration=0.2):
    time = np.arange(0.0, duration, interval)
    values = scale * np.cos(40 * (time - start)) + 1e-3 * np.random.default_rng(seed).standard_normal(time.size)
    return xr.DataArray(values, {"time": time}, dims="time", name="displacement", attrs={"units": "m"})


def five(bad=None):
    starts = [0.05, 0.047, 0.0523, 0.05, 0.051]
    records = [repeat(start, i, 1.3 if i == bad else 1.0) for i, start in enumerate(starts)]
    return records, starts


def test_mean_and_band_of_aligned_repeats():
    found = combine_repeats(*five())
    full = found.n == 5
    truth = np.cos(40 * found.time[full])
    np.testing.assert_allclose(found.displacement_mean[full], truth, atol=3e-3)
    assert float(found.displacement_sd[full].mean()) == pytest.approx(1e-3, rel=0.25)
    assert 0.0 in found.time
    assert int(found.n[0]) == 1
    assert np.isnan(found.displacement_sd[0])
    assert np.isfinite(found.displacement_mean).all()


def test_outlier_is_flagged_but_kept():
    found = combine_repeats(*five(bad=3))
    assert found.is_outlier.values.tolist() == [False, False, False, True, False]
    centre = int(np.argmin(np.abs(found.time.values)))
    assert float(found.displacement_mean[centre]) == pytest.approx((4 + 1.3) / 5, abs=3e-3)
    assert not combine_repeats(*five()).is_outlier.any()
    records, starts = five(bad=0)  # among three, none can be called wrong
    assert not combine_repeats(records[:3], starts[:3]).is_outlier.any()


def test_unlike_repeats_are_refused():
    records, starts = five()
    with pytest.raises(InputError, match="5 records with 4 starts"):
        combine_repeats(records, starts[:4])
    with pytest.raises(InputError, match="no start"):
        combine_repeats(records, [*starts[:4], np.nan])
    other = records[0].assign_attrs(units="mm")
    with pytest.raises(InputError, match="one unit"):
        combine_repeats([other, *records[1:]], starts)
    turned = records[1].assign_coords(time=records[1]["time"].values[::-1])
    with pytest.raises(InputError, match="time of repeat 2 must increase"):
        combine_repeats([records[0], turned], starts[:2])
