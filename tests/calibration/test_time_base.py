"""Time base: interval with uncertainty, and the delay of a moving average."""

import numpy as np
import pytest

from calibration._time_base import corrected, filter_delay, time_base
from labpipe.errors import InputError
from labpipe.units import Quantity

ATTRS = {"sampling_interval": 500e-6, "sampling_cycle": 50e-6, "averaging": 64}


def test_average_of_a_ramp_read_at_corrected_times_is_the_ramp():
    time = np.arange(200) * 50e-6
    ramp = 3.0 * time
    averaged = np.convolve(ramp, np.ones(8) / 8, mode="valid")
    attrs = {"sampling_interval": 50e-6, "averaging": 8}
    base = time_base(attrs)
    np.testing.assert_allclose(averaged, 3.0 * corrected(time[7:], base, 50e-6), rtol=1e-12)


def test_calibrated_clock_stretches_the_time():
    base = time_base(ATTRS, Quantity(1e-4, 1e-6, "1"), averaging=1)
    assert base.interval == pytest.approx(500e-6 * 1.0001, rel=1e-12)
    assert base.u_interval == pytest.approx(500e-6 * 1e-6, rel=1e-9, abs=0.0)
    assert (base.averaging, base.delay, base.is_calibrated) == (1, 0.0, True)


def test_senseless_inputs_are_refused():
    with pytest.raises(InputError, match="sampling_interval"):
        time_base({})
    with pytest.raises(InputError, match="averaging >= 1"):
        filter_delay(0, 50e-6)
    with pytest.raises(InputError, match="averaging >= 1"):
        time_base(ATTRS, averaging=0)
