"""Mistakes with films of a contact are named; clean films are believed."""

import re
import warnings
from pathlib import Path

import msgspec
import numpy as np
import pytest
import xarray as xr

from labpipe import contact, materials
from labpipe.judging import explain
from labpipe.judging._cause import in_turn
from labpipe.units import Quantity
from labpipe.workflow.context import Context, Failed
from pipelines.experiments.contact_area import _image_checks, checks
from pipelines.experiments.contact_area._axes import u_of_view, with_uneven_scale
from pipelines.experiments.contact_area._frame_checks import none_lost
from pipelines.experiments.contact_area.comparison import comparison
from pipelines.experiments.contact_area.measured import impacts
from pipelines.experiments.contact_area.model import model
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.judgements import believed
from pipelines.experiments.shared.settings import Sphere
from pipelines.process import process, result
from tests.pipelines.deviations import write_specimens

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


def enlarged(film, factor):
    for name in ("radius", "u_radius", "radius_systematic"):
        film[name].values[:] *= factor
    return film


def test_a_clean_film_is_believed_and_says_what_it_could_notice(film):
    found, result = judged(film)
    assert found.believable == "yes", found.findings
    assert not found.findings
    assert result.attrs["model"] == "agrees"
    noticed = dict(zip(result["input"].values.tolist(), result["detectable"].values.tolist(), strict=True))
    assert noticed["scale of the image"] < 0.02
    assert 0.01 < noticed["height"] < 0.2


@pytest.mark.parametrize(("factor", "said"), [(36.0, "36 times too large"), (1 / 36.0, "too small by a factor of 36")])
def test_the_scale_of_another_view_names_the_record(film, factor, said):
    found, _ = judged(enlarged(film, factor), wavelength=None)
    assert found.believable == "impossible"
    told = finding(found, "largest radius")
    assert told.file == SETTINGS.camera
    assert "of another view" in told.cause
    assert said in told.cause


def test_a_contact_larger_than_half_the_sphere_is_impossible(film):
    found, _ = judged(enlarged(film, 10.0))
    assert finding(found, "contact radius over the sphere's").level == "impossible"


def test_green_light_for_red_is_named_by_the_fringes(film):
    film.attrs["phase_scale_ratio"] = 532.0 / 632.8
    found, _ = judged(film, wavelength=Quantity(532e-9, 0.0, "m"))
    told = finding(found, "spacing of the fringes")
    assert told.level == "impossible"
    assert "633 nm" in told.cause
    assert "532 nm" in told.cause
    assert told.setting == "wavelength"


def test_frames_of_an_impact_that_show_no_contact_are_named(film):
    top = int(np.nanargmax(film["radius"].values))
    for name, value in (("in_contact", False), ("method", 0), ("radius", np.nan)):
        film[name].values[top + 1] = value
    found, _ = judged(film)
    told = finding(found, "contacts without gaps")
    assert (found.believable, told.level) == ("doubtful", "doubtful")
    assert f"frame {top + 1} within an impact shows no contact" in told.message


@pytest.mark.parametrize(("tilt", "level"), [(0.0, None), (2.0, None), (6.0, "note"), (10.0, "doubtful")])
def test_rings_that_a_camera_sees_aslant_are_told_and_make_the_radius_uncertain(film, tilt, level):
    """The longer axis is that of the contact: between it and equal area lies what the uncertainty allows for."""
    ratio = np.cos(np.deg2rad(tilt))
    radius = film["radius"]
    axes = {"semi_axis_major": radius / np.sqrt(ratio), "semi_axis_minor": radius * np.sqrt(ratio)}
    film = film.assign(axes | {"axis_angle": radius * 0.0, "u_pixel_size": 2.2e-3 * film["pixel_size"]})
    told = [c for c in judged(film)[0].checks if c.level and c.name == "shape of the rings"]
    assert [f.level for f in told] == ([] if level is None else [level])
    assert all(f"at {tilt:g}° from straight" in f.message and "aslant" in f.cause for f in told)
    assert u_of_view(film) == pytest.approx((1.0 - np.sqrt(ratio)) / np.sqrt(3.0))
    parts = xr.zeros_like(film["radius_systematic"]).expand_dims(source=["pixel_size"], axis=1)
    wide = with_uneven_scale(film.assign(systematic_part=parts), 0.01)
    np.testing.assert_allclose(wide["systematic_part"].sel(source="pixel_size"), 0.01 * radius)
    np.testing.assert_allclose(wide["radius_systematic"], np.hypot(film["radius_systematic"], 0.01 * radius))


def test_fringes_that_contradict_the_ruler_say_what_each_would_have_to_be(film):
    film.attrs["phase_scale_ratio"] = 1.0201
    told = finding(judged(film)[0], "spacing of the fringes")
    said = re.search(
        r"R times wavelength is ([\d.]+) times .* a sphere of ([\d.]+) mm in radius, stated are ([\d.]+) mm.* "
        r"or else a pixel ([\d.]+) times as long",
        told.message,
    )
    assert said is not None
    ratio, asked, stated, pixel = map(float, said.groups())
    assert asked / stated == pytest.approx(ratio, abs=1e-3)
    assert pixel == pytest.approx(ratio**-0.5, abs=1e-3)
    assert pixel == pytest.approx(1.01, abs=1.5e-3)


def test_fringes_darker_than_dark_are_impossible(film):
    """What 532 nm for 633 nm makes of a film whose contacts a phase and a gap explain otherwise."""
    film["visibility"] = film["visibility"] * 1.5
    told = finding(judged(film)[0], "visibility of the fringes")
    assert (told.level, told.setting) == ("impossible", "wavelength")
    assert "wavelength of 633 nm" in told.cause


def test_a_frame_rate_ten_times_too_high_is_named_by_the_flights(film):
    film["time"] = film["time"] / 10
    found, _ = judged(film)
    told = finding(found, "first flight")
    assert told.level == "impossible"
    assert "frame rate is 10 times the true one" in told.cause


def test_a_film_of_another_height_is_named(film):
    found, _ = judged(film, height=Quantity(15e-3, 5e-6, "m"))
    told = finding(found, "first flight")
    assert told.level == "impossible"
    assert (told.setting, "1.5" in told.cause) == ("height", True)


def test_an_impact_that_no_frame_shows_is_named_by_the_flight_across_it(film):
    tops = impacts(film, settings=SETTINGS)["peak_time"].values
    found, _ = judged(film.isel(frame=np.abs(film["time"].values - tops[1]) > 2e-3))
    missed = finding(found, "impacts in turn")
    assert missed.level == found.believable == "doubtful"
    assert f"between frames {round(1e4 * tops[0])} and {round(1e4 * tops[2])} was not recorded" in missed.cause
    whole, _ = judged(film)
    assert not any(c.name == "impacts in turn" and c.level for c in whole.checks)


@pytest.mark.parametrize("about", [None, 20])
def test_frames_lost_in_flight_are_blamed_where_no_height_explains_it(film, about):
    """The model ended with the film, before its third impact, and the sentence was empty."""
    peaks = np.rint(impacts(film, settings=SETTINGS)["peak_time"].values * 1e4).astype(int)
    kept = np.arange(peaks[2] + 15)
    near = np.abs(kept[:, None] - peaks).min(axis=1)
    # 120 frames of the second flight, or all but bursts about the contacts
    kept = kept[near < about] if about else np.delete(kept, np.arange(peaks[1] + 50, peaks[1] + 170))
    cut = film.isel(frame=kept).assign(frame=np.arange(kept.size), time=("frame", 1e-4 * np.arange(kept.size)))
    told = finding(judged(cut)[0], "first flight")
    assert ("frames of the flights were lost" if about else "frames were lost between") in told.cause


def test_exchanged_frames_are_found_by_their_times_and_by_the_growth(film):
    time = film["time"].values.copy()
    time[[180, 181]] = time[[181, 180]]
    told = finding(judged(film.assign_coords(time=("frame", time)))[0], "times of the frames")
    assert (told.level, "exchanged" in told.cause, "181" in told.cause) == ("impossible", True, True)
    for name in ("radius", "centre_x", "centre_y"):
        values = film[name].values
        values[[177, 180]] = values[[180, 177]]
    told = finding(judged(film)[0], "growth of the contact")
    assert (told.level, "exchanged" in told.cause) == ("doubtful", True)


@pytest.mark.parametrize(("method", "level"), [(1, "doubtful"), (5, None)])
def test_frames_lost_at_the_top_of_a_contact_are_told_though_the_others_were_numbered_anew(film, method, level):
    area = 6e-4**2 * np.sin(np.pi * np.linspace(0.02, 0.99, 30) ** 1.1)
    a = np.sqrt(np.delete(area, np.arange(12, 16)))  # the largest is number 15
    film = film.isel(frame=np.arange(100, 100 + a.size))
    film["radius"].values[:] = a
    film["method"].values[:] = method
    ends = xr.Dataset(
        {name: ("impact", film["time"].values[[at]]) for name, at in (("first_seen", 0), ("last_seen", -1))}
    )
    told = none_lost(film, ends, SETTINGS)
    assert told.level == level
    if level:
        assert "smooth only if frames are missing after frame 111" in told.message


def test_a_second_drop_after_the_third_impact_is_noted(film):
    twice = xr.concat([film, film.isel(frame=slice(0, 400))], "frame")
    twice = twice.assign_coords(frame=np.arange(twice.sizes["frame"]))
    twice["time"] = ("frame", np.arange(twice.sizes["frame"]) * 1e-4)
    assert finding(judged(twice.assign_attrs(film.attrs))[0], checks.ORDER).level == "note"
    assert not any(c.level and c.name == checks.ORDER for c in judged(film)[0].checks)


def test_another_polymer_is_told_beside_the_mass(film):
    told = finding(judged(film, sphere=msgspec.structs.replace(SETTINGS.sphere, material="nbr"))[0], checks.RADIUS)
    assert "sphere.mass in session.toml); or the polymer is another than stated, some" in told.cause
    assert told.cause.endswith("times stiffer in the impact")


def test_a_repeated_frame_is_found(film):
    for name in ("radius", "centre_x", "centre_y"):
        film[name].values[180] = film[name].values[179]
    told = finding(judged(film)[0], "frames differ")
    assert (told.level, "frame 180" in told.cause) == ("doubtful", True)


def test_edges_instead_of_fringes_are_doubtful(film):
    film["method"] = film["method"] * 2
    told = finding(judged(film)[0], "fringes are resolved")
    assert (told.level, "not resolved" in told.cause) == ("doubtful", True)


def test_a_record_of_another_day_is_impossible():
    text = "the record was valid until 2023-04-30, the film is of 2024-05-14"
    failed = (Failed("radius", None, text),)
    context = Context("film", "contact_area", "", "", "", True, failures=failed)
    found = believed(checks.judgement(None, None, None, None, settings=SETTINGS, context=context))
    assert found.believable == "impossible"
    assert "view or day" in found.causes[0]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [5001, 6009])
def test_a_poor_fit_of_hertz_gap_is_replaced_by_the_edge_of_the_contact(tmp_path: Path, seed: int) -> None:
    """In one frame of these films a contact that opens was taken for one that is 90 µm wider."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        write_specimens(tmp_path, seed)
        process(tmp_path, ["judgement"], jobs=0, only=["film"])
    assert believed(result(tmp_path, "film", "judgement")).believable == "yes"
    largest = result(tmp_path, "film", "impacts")["peak_radius"].values
    assert (np.diff(largest) < 0.0).all()
    assert largest == pytest.approx([8.4e-4, 8.1e-4, 7.8e-4], rel=0.02)


def test_a_film_that_runs_backwards_does_not_blame_the_height(film):
    values = {name: film[name].values[::-1].copy() for name in film.data_vars}
    found, _ = judged(film.assign({name: ("frame", value) for name, value in values.items()}))
    assert {f.cause for f in found.findings} == {"the frames stand in reverse order"}
    assert finding(found, "order of the impacts").level == "impossible"


@pytest.mark.parametrize(("quiet", "said"), [(2e-3, True), (0.05, False)])
def test_two_impacts_after_one_that_was_cut_off_tell_that_the_film_begins_late(quiet, said):
    e = 0.8
    fall, a = np.sqrt(2 * 1.5e-3 / 9.81), 4e-4 * np.array([1.0, e**0.4])
    made = xr.Dataset({"peak_contact_radius": ("impact", a), "restitution": ("impact", [e, e])})
    made["contact_duration"] = ("impact", [1e-3, 1e-3])
    # impacts 2 and 3 of that drop
    start = quiet + np.array([0.0, 2 * e**2 * fall + 1e-3])
    seen = xr.Dataset({"peak_radius": ("impact", a * e**0.4), "u_peak_radius": ("impact", [1e-6, 1e-6])})
    for name, at in (("first_seen", start), ("peak_time", start + 5e-4), ("last_seen", start + 1e-3)):
        seen[name] = ("impact", at)
    time = np.arange(0.0, 0.1, 1e-5)
    radius = xr.Dataset(coords={"time": ("frame", time)}, attrs={"u_systematic_relative": 1e-3})
    radius["valid"] = ("frame", np.ones(time.size, bool))
    told = checks._flight(radius, seen, SETTINGS, made)
    assert told.level == "doubtful"
    assert np.exp(told.log_ratio) == pytest.approx(e, rel=1e-3)
    causes = explain([told], list(checks._causes(SETTINGS, radius, seen)))
    assert ("the film begins too late" in in_turn(causes, told.name)) == said
    assert "height" in in_turn(causes, told.name)


@pytest.mark.parametrize(("exposure", "level"), [(2e-6, None), (9e-5, "doubtful")])
def test_a_stated_exposure_is_held_against_the_smear_of_the_fringes(film, exposure, level):
    speed = np.abs(np.gradient(film["radius"].values, film["time"].values))
    film["travel"] = ("frame", 2e-6 * speed)
    found = _image_checks._shutter(film, msgspec.structs.replace(SETTINGS, exposure=Quantity(exposure, 0.0, "s")))
    assert found.level == level
    assert found.is_made
