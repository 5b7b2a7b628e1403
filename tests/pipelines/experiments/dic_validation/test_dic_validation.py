"""A film of the holder against the laser's drops: results against the truth of both."""

from pathlib import Path

import numpy as np
import pytest

from labpipe.uncertainty import linear_budget
from pipelines.rig.drops import DropRig, write_drops
from pipelines.rig.film_front import FrontCamera, front_section, write_front
from pipelines.rig.session_text import drop_section, front_record, laser_record
from pipelines.rig.solids import specimen_of
from pipelines.session import result
from tests.labpipe.report.conftest import assert_fit_to_read
from tests.pipelines.budgets import quantities
from tests.pipelines.sessions import begun, copied, page_of, processed, truth
from tests.pipelines.small import START

CAMERA = FrontCamera(rows=72, columns=48, frame_rate=4000, duration=0.075, release=0.006)
HEIGHT = 1.5e-3


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("film")
    laser = write_drops(folder, "drop", DropRig(duration=0.1), specimen_of("acrylic"), HEIGHT, 2, 5, START)
    film = write_front(folder, "acrylic", HEIGHT, CAMERA, 9)
    section = front_section(film, CAMERA, HEIGHT).replace("ptfe_1p5mm", "drop").replace("ptfe_film", "film")
    sections = drop_section("drop", laser, HEIGHT, "acrylic") + section
    return processed(begun(folder, sections, laser=laser_record(), camera_front=front_record()), only=["film"])


def test_the_track_is_the_true_one_within_its_own_uncertainty(session: Path) -> None:
    found = result(session, "film", "track").isel(point=0)
    known = truth(session, "acrylic_front")
    expected = np.array(known["dy"])[found["frame"].values]
    error = found["dy"].values - expected
    assert np.abs(error).max() < 0.03
    assert error.std() < 1.5 * float(found["u_dy"].median())


def test_contact_is_found_to_a_tenth_of_a_frame(session: Path) -> None:
    found = result(session, "film", "bounces")
    gap = float(found["first_contact_time"]) - truth(session, "acrylic_front")["first_contact_time"]
    assert abs(gap) < 0.1 / CAMERA.frame_rate


def test_film_and_laser_agree_within_the_calibrations(session: Path) -> None:
    found = result(session, "film", "comparison")
    assert float(found["nrmse"]) < 0.02
    allowed = 3 * float(np.hypot(found["u_displacement_ratio"], found["scale_uncertainty"]))
    assert abs(float(found["displacement_ratio"]) - 1) < allowed
    assert float(found["u_bias"]) > 0.9 * abs(float(found["scale_uncertainty"] * found["film"].mean()))
    z = found["restitution_difference"] / found["u_restitution_difference"]
    assert np.all(np.abs(z) < 3.5)


def test_the_page_is_fit_to_read(session: Path, tmp_path: Path) -> None:
    page = session / "labpipe/reports/film.html"
    assert "Raw header of film/" in page.read_text("utf-8")
    assert_fit_to_read(page, tmp_path)


def test_masks_and_obstructions_are_left_out_and_drawn(session: Path, tmp_path: Path) -> None:
    masks = "regions = [[[4, 4], [40, 4], [40, 68], [4, 68]]]\ncovers = [[[18, 20], [28, 20], [28, 30], [18, 30]]]"
    masks += "\nobstructions = [[[32, -5], [36, -5], [36, 80], [32, 80]]]"
    table = "[experiments.film.tracking]\n"
    folder = processed(copied(session, tmp_path, table, f"{table}{masks}\n"), only=["film"])
    found, plain = (result(where, "film", "track").isel(point=0) for where in (folder, session))
    expected = np.array(truth(session, "acrylic_front")["dy"])[found["frame"].values]
    assert np.abs(found["dy"].values - expected).max() < 0.04
    assert float(found["u_dy"].median()) > 1.1 * float(plain["u_dy"].median())
    page, other = (page_of(where, "film") for where in (folder, session))
    for words in ("purple: covered parts that do not", "ochre: obstructions", "hidden of it"):
        assert words in page
        assert words not in other


def test_a_wrong_pixel_size_shows_against_the_laser(session: Path, tmp_path: Path) -> None:
    """The comparison can fail: 355 instead of 386 px in 30 mm make every length 9 % too large."""
    folder = copied(session, tmp_path, "386 ±", "355 ±", "calibration/camera_front.toml")
    found = result(processed(folder, ["comparison"], ["film"]), "film", "comparison")
    assert float(found["nrmse"]) > 0.03
    assert float(found["displacement_ratio"]) == pytest.approx(386 / 355, rel=0.02)


def test_scale_and_noise_stand_in_the_budgets(session: Path) -> None:
    found = quantities(session, "film")
    for quantity in found.values():
        budget = linear_budget(quantity.model, quantity.inputs)
        assert budget.u > 0.0
        assert all(row["u"] > 0.0 for row in budget.rows if row["source"] != "measured")
