"""The calibration images measure back to table D.1."""

from pathlib import Path

import cv2
import pytest

from calibration.ruler import graduations
from pipelines.app._measuring import length
from pipelines.rig.calibration_images import write_calibration_images


def test_ruler_and_holder_measure_what_table_d1_says(tmp_path: Path) -> None:
    ruler, holder = (
        cv2.imread(str(tmp_path / name), cv2.IMREAD_GRAYSCALE) for name in write_calibration_images(tmp_path)
    )
    found = graduations(ruler)
    assert 10 * found.pitch.value == pytest.approx(461.0, abs=0.1)
    assert abs(found.tilt.value) == pytest.approx(0.012, abs=1e-3)
    width = length(holder.astype(float), (126.5, 119.5), (512.5, 119.5))
    assert width.value == pytest.approx(386.0, abs=0.1)
