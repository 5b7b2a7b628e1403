"""Mistakes with films of a contact are named; clean films are believed."""

import re

import msgspec
import numpy as np
import pytest
import xarray as xr

from labpipe import contact, materials
from labpipe.units import Quantity
from labpipe.workflow.context import Context, Failed
from pipelines.experiments.contact_area import checks
from pipelines.experiments.contact_area.comparison import comparison
from pipelines.experiments.contact_area.measured import impacts
from pipelines.experiments.contact_area.model import model
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.judgements import believed
from pipelines.experiments.shared.settings import Sphere

CONTEXT = Context("film", "contact_area", "", "", "", True)
SETTINGS = ContactArea(
    kind="contact_area",
    film="film/a.cine",
    camera="calibration/camera_under.toml",
    height=Quantity(1.5e-3, 5e-6, "m"),
    wavelength=Quantity(633e-9, 0.0, "m"),
    sphere=Sphere(
        radius=Quantity(9.525e-3, 5e-6, "m"), mass=Quantity(0.505, 5e-4, "kg"), material="acrylic", temperature=None
    ),
)


@pytest.fixture(scope="module")
def drop() -> xr.Dataset:
    times = 1e-4 * np.arange(0, 1300)
    return contact.drop(materials.load("acrylic"), 9.525e-3, 0.505, 1.5e-3, 0.13, times=times)


@pytest.fixture
def film(drop: xr.Dataset) -> xr.Dataset:
    """What the stage ``radius`` makes of a film at 10 kHz."""
    random = np.random.default_rng(1)
    a = drop["contact_radius"].values[:900].copy()
    seen = a > 50e-6
    count = a.size
    u = np.full(count, 1e-7)
    radius = np.where(seen, a + u * random.standard_normal(count), np.nan)
    values = {
        "radius": radius,
        "u_radius": u,
        "radius_systematic": 2.2e-3 * np.where(seen, a, np.nan),
        "in_contact": seen,
        "method": np.where(seen, 1, 0),
        "visibility": np.where(seen, 0.82, np.nan),
        "valid": np.ones(count, bool),
        "centre_x": random.normal(200.0, 0.01, count),
        "centre_y": random.normal(60.0, 0.01, count),
        "u_centre_x": np.full(count, 0.01),
        "u_centre_y": np.full(count, 0.01),
    }
    return xr.Dataset(
        {name: ("frame", array) for name, array in values.items()},
        {"time": ("frame", 1e-4 * np.arange(count)), "frame": np.arange(count), "pixel_size": 2.17e-6},
        {"phase_scale_ratio": 1.0, "u_phase_scale_ratio": 1e-3, "u_systematic_relative": 2.2e-3},
    )


def judged(film, context=CONTEXT, **changes):
    settings = msgspec.structs.replace(SETTINGS, **changes)
    found = impacts(film, settings=settings)
    made = model(film, found, None, None, None, settings=settings)
    compared = comparison(film, found, made, settings=settings)
    result = checks.judgement(film, found, made, compared, settings=settings, context=context)
    return believed(result), result


def finding(found, check):
    return next(c for c in found.checks if c.level and c.name == check)


def test_a_clean_film_is_believed_and_says_what_it_could_notice(film):
    found, result = judged(film)
    assert found.believable == "yes", found.findings
    assert not found.findings
    assert result.attrs["model"] == "agrees"
    noticed = dict(zip(result["input"].values.tolist(), result["detectable"].values.tolist(), strict=True))
    assert noticed["scale of the image"] < 0.02
    assert 0.01 < noticed["height"] < 0.2


def test_frames_of_an_impact_that_show_no_contact_are_named(film):
    top = int(np.nanargmax(film["radius"].values))
    for name, value in (("in_contact", False), ("method", 0), ("radius", np.nan)):
        film[name].values[top + 1] = value
    found, _ = judged(film)
    told = finding(found, "contacts without gaps")
    assert (found.believable, told.level) == ("doubtful", "doubtful")
    assert f"frame {top + 1} within an impact shows no contact" in told.message


def test_fringes_that_contradict_the_ruler_say_what_each_would_have_to_be(film):
    film.attrs["phase_scale_ratio"] = 1.0201
    told = finding(judged(film)[0], "spacing of the fringes")
    said = re.search(
        r"R times wavelength, .*, is ([-+.\d]+) % .* a sphere of ([\d.]+) mm in radius, stated are ([\d.]+) mm.* "
        r"or else a pixel is ([-+.\d]+) % longer",
        told.message,
    )
    assert said is not None
    change, asked, stated, pixel = map(float, said.groups())
    assert 100 * (asked / stated - 1) == pytest.approx(change, abs=0.1)
    assert change == pytest.approx(100 / 1.0201 - 100, abs=0.1)
    assert pixel == pytest.approx(1.0, abs=0.1)


def test_another_polymer_is_told_beside_the_mass(film):
    told = finding(judged(film, sphere=msgspec.structs.replace(SETTINGS.sphere, material="nbr"))[0], checks.RADIUS)
    assert "sphere.mass in session.toml); or the polymer is another than stated, some" in told.cause
    assert told.cause.endswith("times stiffer in the impact")


def test_a_record_of_another_day_is_impossible():
    text = "the record was valid until 2023-04-30, the film is of 2024-05-14"
    failed = (Failed("radius", None, text),)
    context = Context("film", "contact_area", "", "", "", True, failures=failed)
    found = believed(checks.judgement(None, None, None, None, settings=SETTINGS, context=context))
    assert found.believable == "impossible"
    assert "view or day" in found.causes[0]


@pytest.mark.parametrize(("exposure", "level"), [(2e-6, None), (9e-5, "doubtful")])
def test_a_stated_exposure_is_held_against_the_smear_of_the_fringes(film, exposure, level):
    speed = np.abs(np.gradient(film["radius"].values, film["time"].values))
    film["travel"] = ("frame", 2e-6 * speed)
    found = checks._shutter(film, msgspec.structs.replace(SETTINGS, exposure=Quantity(exposure, 0.0, "s")))
    assert found.level == level
    assert found.is_made
