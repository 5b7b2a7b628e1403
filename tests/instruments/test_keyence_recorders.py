"""Tables of recorders read as storage files: times are believed as written, units of the file count."""

import numpy as np
import pytest

from instruments import keyence
from labpipe.errors import SourceError

TIME = np.arange(40) * 2e-4
FALL = 3.1 - 4905 * TIME**2
LVM = "LabVIEW Measurement\nChannels\t1\nSamples\t40\nY_Unit_Label\tVolts\nDelta_X\t2.0E-4\n***End_of_Header***\t\n"


def write(folder, head, time, form="{:.7f}", sep=","):
    path = folder / "a.csv"
    rows = (f"{form.format(t)}{sep}{z:.5f}\n" for t, z in zip(time, FALL, strict=True))
    path.write_text(head + "".join(rows), "utf-8")
    return path


@pytest.mark.parametrize("form", ["{:.7f}", "{:.6E}", "{:.3e}"])
@pytest.mark.parametrize("lost", [None, 20])
def test_times_are_believed_in_every_notation(tmp_path, form, lost):
    time = TIME if lost is None else np.where(np.arange(40) >= lost, TIME + 2e-4, TIME)
    path = write(tmp_path, "Time (s),Displacement (mm)\n", time, form)
    if lost is None:
        assert keyence.read(path).attrs["sampling_interval"] == pytest.approx(2e-4)
        return
    with pytest.raises(SourceError, match=r"the times are uneven: a step of 0\.0004 s"):
        keyence.read(path)


def test_two_rates_are_refused(tmp_path):
    time = np.cumsum(np.where(np.arange(40) < 20, 2e-4, 4e-4))
    with pytest.raises(SourceError, match="the times are uneven"):
        keyence.read(write(tmp_path, "Time (s),Displacement (mm)\n", time, "{:.6E}"))


@pytest.mark.parametrize("head", ["Time,Channel A\n(ms),(mV)\n\n", "Time (ms) Run #1,Position (mV) Run #1\n"])
def test_a_column_of_times_is_no_output_and_its_units_count(tmp_path, head):
    path = write(tmp_path, head, TIME * 1e3)
    found = keyence.read(path)
    assert [name for name in found.data_vars if name.startswith("out")] == ["out1"]
    np.testing.assert_allclose(found.out1, FALL * 1e-3, atol=1e-8)
    assert found.out1.attrs["units"] == "V"
    assert found.attrs["sampling_interval"] == pytest.approx(2e-4)
    with pytest.raises(SourceError, match="units"):
        keyence.read(path, units=["mm"])
    with pytest.raises(SourceError, match="the option units says"):
        keyence.read(path, units=["mm", "mm"], cycle="200 us")


def test_the_unit_of_a_labview_header_counts(tmp_path):
    path = tmp_path / "a.lvm"
    path.write_text(LVM + "X_Value\tVoltage\tComment\n" + "".join(f"\t{z:.6f}\n" for z in FALL), "utf-8")
    with pytest.raises(SourceError, match="Volts"):
        keyence.read(path, units=["mm"], cycle="200 us")
