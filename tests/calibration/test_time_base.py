"""Time base: interval with uncertainty, and the delay of a moving average."""

import numpy as np
import pytest

from calibration._time_base import corrected, time_base
from labpipe.errors import InputError

ATTRS = {"sampling_interval": 500e-6, "sampling_cycle": 50e-6, "averaging": 64}


def test_average_of_a_ramp_read_at_corrected_times_is_the_ramp():
    time = np.arange(200) * 50e-6
    ramp = 3.0 * time
    averaged = np.convolve(ramp, np.ones(8) / 8, mode="valid")
    attrs = {"sampling_interval": 50e-6, "averaging": 8}
    base = time_base(attrs)
    np.testing.assert_allclose(averaged, 3.0 * corrected(time[7:], base, 50e-6), rtol=1e-12)


def test_senseless_inputs_are_refused():
    with pytest.raises(InputError, match="sampling_interval"):
        time_base({})
    with pytest.raises(InputError, match="averaging >= 1"):
        time_base(ATTRS, averaging=0)
