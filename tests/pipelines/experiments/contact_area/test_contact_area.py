"""A film through the disc: radius, impacts and rest against the rig's truth, and the model."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from labpipe import materials
from labpipe.errors import InputError
from labpipe.uncertainty import linear_budget
from pipelines.experiments.contact_area.measured import radius
from pipelines.rig.drops import Body
from pipelines.rig.film_under import UNDER_HEIGHT, Bursts, UnderCamera, burst_times, under_section, write_under
from pipelines.rig.reference_drop import Floor
from pipelines.rig.session_text import under_record
from pipelines.session import result
from tests.labpipe.report.conftest import assert_fit_to_read
from tests.pipelines.budgets import quantities
from tests.pipelines.sessions import begun, copied, page_of, processed, settings_of, truth

CAMERA = UnderCamera(samples=3, moments=2)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("under")
    body = Body(materials.load("acrylic"), UNDER_HEIGHT, floor=Floor())
    times = burst_times(body, CAMERA.release, Bursts())
    times = times[(times < 0.023) | (times > 0.6)]  # the first impact, and rest
    film = write_under(folder, "acrylic_under", body, CAMERA, times, 5)
    return processed(begun(folder, under_section(film), camera_under=under_record()), only=["acrylic_film"])


def test_contact_is_seen_where_it_is(session: Path) -> None:
    found = result(session, "acrylic_film", "radius")
    known = np.array(truth(session, "acrylic_under")["contact_radius"])
    seen = np.zeros(len(known), dtype=bool)
    seen[found["frame"].values] = found["in_contact"].values
    assert seen[known > 150e-6].all()
    assert not seen[known == 0].any()


def test_the_radius_is_the_true_one(session: Path) -> None:
    found = result(session, "acrylic_film", "radius")
    seen = found["in_contact"].values.astype(bool)
    known = np.array(truth(session, "acrylic_under")["contact_radius"])[found["frame"].values]
    error = (found["radius"].values - known)[seen]
    growing = np.diff(known, append=0.0)[seen] > 0
    assert np.median(np.abs(error)) < 2e-6
    # A surface that still recovers is no Hertz contact: only the growing one is read that well.
    # (At rest the truth itself is known to a spring's width only, about 1 µm.)
    large = known[seen] > 300e-6
    assert np.abs(error[growing & large]).max() < 0.5e-6
    i = int(np.nanargmax(found["radius"].values))
    assert abs(float(found["radius"][i]) - known[i]) < 2e-6


def test_the_largest_radius_agrees_with_the_model(session: Path) -> None:
    found = result(session, "acrylic_film", "comparison")
    z = found["peak_radius_difference"] / found["u_peak_radius_difference"]
    assert abs(float(z[0])) < 3
    assert float(found["nrmse"][0]) < 0.03


def test_the_page_is_fit_to_read(session: Path, tmp_path: Path) -> None:
    page = session / "labpipe/reports/acrylic_film.html"
    text = page.read_text("utf-8")
    assert "Raw header of film/" in text
    assert "Film with the fitted circle" in text
    assert len(text.encode()) < 3_000_000
    assert_fit_to_read(page, tmp_path)


def test_budgets_are_those_of_the_results(session: Path) -> None:
    found = quantities(session, "acrylic_film")
    made, model = (result(session, "acrylic_film", stage) for stage in ("comparison", "model"))
    for name, u in (
        ("largest contact radius, impact 1", made["u_peak_radius_film"]),
        ("largest contact radius of the model, impact 1", model["u_peak_contact_radius"]),
    ):
        budget = linear_budget(found[name].model, found[name].inputs)
        assert budget.u == pytest.approx(float(u[0]), rel=1e-3)


@pytest.mark.filterwarnings("ignore:.*recorded in bursts")
def test_a_region_around_the_contact_gives_the_same_circle(session: Path) -> None:
    whole = result(session, "acrylic_film", "radius")
    settings = settings_of(session, "acrylic_film")
    rows, columns = CAMERA.rows, CAMERA.columns
    corners = ((columns - 5.5, rows - 7.0), (4.0, 6.0))
    film, record = session / settings.film, session / settings.camera
    found = radius(film, record, settings=msgspec.structs.replace(settings, region=corners), full=False)
    both = whole["in_contact"].values.astype(bool)
    assert (found["in_contact"].values.astype(bool) == both).mean() > 0.98
    assert np.nanmedian(np.abs(found["radius"] - whole["radius"])[both]) < 0.2e-6
    for name in ("centre_x", "centre_y"):
        assert np.nanmedian(np.abs(found[name] - whole[name])[both]) < 0.1  # px of the whole frame
    small = msgspec.structs.replace(settings, region=((0.0, 0.0), (20.0, 50.0)))
    with pytest.raises(InputError, match="less than 32 px wide or high"):
        radius(film, record, settings=small, full=False)
    assert rows < columns
    swapped = msgspec.structs.replace(settings, region=((0.0, 0.0), (rows - 1.0, columns - 1.0)))
    with pytest.raises(InputError, match="x and y are exchanged") as refused:
        radius(film, record, settings=swapped, full=False)
    assert refused.value.reason == "region"


@pytest.mark.parametrize(
    ("stated", "told"),
    [("", "up to 1.4 µm farther out"), ('work_of_adhesion = "20 ± 5 mJ/m2"', "JKR with the stated (20.0 ± 5.0) mJ/m²")],
)
def test_the_edge_of_an_adhesive_contact_is_told(session: Path, tmp_path: Path, stated: str, told: str) -> None:
    folder = copied(session, tmp_path, "wavelength =", f"{stated}\nwavelength =")
    assert told in page_of(processed(folder, only=["acrylic_film"]), "acrylic_film")
    beyond = float(result(folder, "acrylic_film", "model")["adhesion_shift"][0])
    found = quantities(folder, "acrylic_film")
    assert beyond == pytest.approx(found["largest contact area, impact 1"].inputs["adhesion"].value)
    assert "adhesion" not in found["largest contact radius, impact 1"].inputs
    assert beyond == pytest.approx(0.89e-6 if stated else 0.71e-6, rel=0.03)
