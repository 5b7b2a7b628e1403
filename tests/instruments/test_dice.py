"""DICe folders: columns by name, failed points, skipped numbers, damage."""

from pathlib import Path

import numpy as np
import pytest

import instruments
from labpipe.errors import SourceError

HEADER = "SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA,GAMMA,MATCH"


def write_run(folder: Path, numbers: tuple[int, ...] = (0, 20, 40), sigma: float = 0.004) -> None:
    folder.mkdir()
    for k, number in enumerate(numbers):
        rows = [f"{p},{10 + p}.0,{20 + p}.0,{0.5 * k:.4E},{-1.5 * k:.4E},{sigma:.4E},1E-3,0" for p in range(3)]
        preamble = "*** Digital Image Correlation Engine (DICe)\n*** Image: x\n"
        text = preamble + HEADER + "\n" + "\n".join(rows) + "\n"
        (folder / f"DICe_solution_{number:03d}.txt").write_text(text)


def test_a_run_is_read_by_the_names_of_its_fields(tmp_path: Path) -> None:
    write_run(tmp_path / "run")
    assert instruments.identify(tmp_path / "run") == "dice"
    found = instruments.read(tmp_path / "run", fps=1000.0)
    assert found["frame"].values.tolist() == [0, 20, 40]
    np.testing.assert_allclose(found["time"], [0, 0.02, 0.04])
    np.testing.assert_allclose(found["dy"], [[0] * 3, [-1.5] * 3, [-3] * 3])
    assert found["x"].values.tolist() == [10, 11, 12]
    assert found["dx"].attrs["units"] == "px"
    assert found["valid"].values.all()


def test_a_failed_point_is_nan_and_said(tmp_path: Path) -> None:
    write_run(tmp_path / "run")
    path = tmp_path / "run/DICe_solution_020.txt"
    path.write_text(path.read_text().replace("4.0000E-03", "-1.0000E+00", 1))
    with pytest.warns(UserWarning, match="1 of 9 points failed"):
        found = instruments.read(tmp_path / "run")
    assert np.isnan(found["dx"].values[1, 0])
    assert not found["valid"].values[1, 0]
    assert np.isfinite(found["dx"].values).sum() == 8


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("DISPLACEMENT_Y", "VALUE_Y", "DISPLACEMENT_Y are missing"),
        ("1,11.0", "1,1x1.0", "1x1"),
        ("2,12.0,22.0", "2,12.0", "found 7 cells, expected 8"),
        ("1,11.0,21.0", "1,15.0,21.0", "points are not the"),
    ],
)
def test_damage_is_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    write_run(tmp_path / "run")
    path = tmp_path / "run/DICe_solution_020.txt"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(SourceError, match=message):
        instruments.read(tmp_path / "run")
