"""Mistakes with films of a falling holder are named; clean films are believed."""

import numpy as np
import pytest
import xarray as xr

from labpipe import contact, materials
from labpipe.errors import InputError
from labpipe.variables import variable
from labpipe.workflow.context import Context
from pipelines.experiments.dic_validation import checks, measured
from pipelines.experiments.dic_validation.comparison import comparison
from pipelines.experiments.dic_validation.settings import DicValidation
from pipelines.experiments.shared.judgements import believed

pytestmark = pytest.mark.filterwarnings(
    "ignore:the record ends before the body is at rest", "ignore:the body was already falling when the record began"
)
CONTEXT = Context("film", "dic_validation", "", "", "", True)
SETTINGS = DicValidation(
    kind="dic_validation", film="film/a.cine", camera="calibration/camera_front.toml", laser_experiment="drop"
)
RELATIVE, RATE, STILL = 4e-3, 4000.0, 0.02


@pytest.fixture(scope="module")
def fallen() -> xr.Dataset:
    return contact.drop(materials.load("ptfe"), 9.525e-3, 0.505, 7e-3, 0.13, times=np.arange(0.0, 0.13, 2.5e-4))


def recorded(fallen: xr.Dataset, seed: int, noise: float = 2e-7, scale: float = 1.0, rate: float = RATE) -> xr.Dataset:
    """What the stage ``motion`` makes of a film that begins before the release."""
    random = np.random.default_rng(seed)
    y = fallen["displacement"].values
    y = np.concatenate([np.full(int(STILL * RATE), y[0]), y]) - y[0]
    y = scale * (y + noise * random.standard_normal(y.size))
    made = xr.Dataset(coords={"time": variable("time", np.arange(y.size) / rate, "s", "time in the film")})
    made["displacement"] = variable("time", y, "m", "displacement")
    made["u_displacement"] = variable("time", np.full(y.size, 5e-7), "m", "its standard uncertainty")
    for name, value in (("direction", 0.0), ("u_direction", 1e-4)):
        made[name] = variable((), value, "rad", name)
    for name, value in (("pixel_size", 7.8e-5), ("u_pixel_size", 7.8e-5 * RELATIVE)):
        made[name] = variable((), value, "m/px", name)
    return made.assign_attrs(u_systematic_relative=RELATIVE)


@pytest.fixture
def motion(fallen: xr.Dataset) -> xr.Dataset:
    return recorded(fallen, 1)


@pytest.fixture(scope="module")
def laser(fallen: xr.Dataset) -> xr.Dataset:
    """What the laser's experiment hands on, from first contact."""
    moved = recorded(fallen, 2)
    found = measured.bounces(moved, settings=SETTINGS)
    start = float(found["first_contact_time"])
    level = moved["displacement"].values - float(found["contact_level"])
    made = found[["restitution", "u_restitution", "incoming_speed", "u_incoming_speed", "touch_time", "u_touch_time"]]
    made["touch_time"] = made["touch_time"] - start
    made["touch_time_sd"] = made["touch_time"] * np.nan  # of a single record
    made = made.assign_coords(time=variable("time", moved["time"].values - start, "s", "time since first contact"))
    made["displacement_mean"] = variable("time", level, "m", "displacement")
    return made.assign_attrs(u_systematic_relative=1e-3)


def tracked(count: int = 1000, share: float = 1.0) -> xr.Dataset:
    """What the stage ``track`` makes of a film, as far as the checks read it; only noise."""
    random = np.random.default_rng(5)
    found = {name: (("frame", "point"), random.normal(0.0, 3e-3, (count, 1))) for name in ("dx", "dy")}
    found |= {
        name: (("frame", "point"), random.normal(0.0, 2e-5, (count, 1)))
        for name in ("rotation", "stretch_x", "stretch_y")
    }
    found["zncc"] = (("frame", "point"), random.normal(0.99, 1e-4, (count, 1)))
    found["valid"] = (("frame", "point"), np.arange(count)[:, None] < count * share)
    return xr.Dataset(found, {"frame": np.arange(count), "time": ("frame", np.arange(count) / RATE)})


def judged(motion, laser=None, share=1.0, track=None):
    track = tracked(share=share) if track is None else track
    try:
        found = measured.bounces(motion, settings=SETTINGS)
        compared = comparison(motion, found, laser, settings=SETTINGS)
    except InputError:  # the record is judged without the steps that fail
        found = compared = None
    result = checks.judgement(track, motion, found, compared, laser, settings=SETTINGS, context=CONTEXT)
    return believed(result), result


def finding(found, check):
    return max((c for c in found.checks if c.name == check), key=lambda c: bool(c.level))


@pytest.mark.parametrize("seed", [1, 3, 4])
def test_a_clean_film_is_believed_and_agrees(fallen, laser, seed):
    found, result = judged(recorded(fallen, seed), laser)
    assert found.believable == "yes", found.findings
    assert not found.findings
    assert 5 < found.n_made <= 12
    assert result.attrs["model"] == "agrees"


def _dropped_from(height: float) -> xr.Dataset:
    return contact.drop(materials.load("ptfe"), 9.525e-3, 0.505, height, 0.16, times=np.arange(0.0, 0.16, 1 / RATE))


MISTAKES = {
    "scale one half": ("impossible", "too small by a factor of 2", lambda fallen: recorded(fallen, 7, scale=0.5)),
    "frame rate x2": ("impossible", "frame rate is 2 times", lambda fallen: recorded(fallen, 7, rate=2 * RATE)),
    "drop from 10 mm": ("impossible", "film or laser_experiment", lambda _: recorded(_dropped_from(10e-3), 7)),
    "drop from 6.5 mm": ("doubtful", "film or laser_experiment", lambda _: recorded(_dropped_from(6.5e-3), 7)),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistake_is_noticed_and_named(fallen, laser, name):
    level, words, film = MISTAKES[name]
    found, _ = judged(film(fallen), laser)
    said = " ".join(f"{f.message} {f.cause}" for f in found.findings)
    assert (found.believable, words in said) == (level, True), said


@pytest.mark.parametrize("has_laser", [True, False])
def test_a_film_that_is_upside_down_is_named(fallen, laser, has_laser):
    found, _ = judged(recorded(fallen, 1, scale=-1.0), laser if has_laser else None)
    told = finding(found, "direction of the fall")
    assert (told.level, told.file) == ("impossible", SETTINGS.film)
    assert "upside down" in told.cause
    assert {f.cause for f in found.findings} == {told.cause}


def test_a_film_of_another_polymer_differs_from_the_laser(laser):
    other = contact.drop(materials.load("acrylic"), 9.525e-3, 0.505, 7e-3, 0.13, times=np.arange(0.0, 0.13, 2.5e-4))
    found, result = judged(recorded(other, 1), laser)
    assert found.believable == "yes"
    assert result.attrs["model"] == "differs"


def test_exchanged_repeated_and_dropped_frames_are_found(motion, laser):
    track = tracked(motion.sizes["time"])
    time = track["time"].values.copy()
    time[[200, 201]] = time[[201, 200]]
    told = finding(judged(motion, laser, track=track.assign_coords(time=("frame", time)))[0], "times of the frames")
    assert (told.level, "exchanged" in told.cause, "frame 201" in told.cause) == ("impossible", True, True)
    kept = np.r_[0:150, 160 : motion.sizes["time"]]
    lost = track.isel(frame=kept).assign_coords(frame=np.arange(kept.size))
    told = finding(judged(motion, laser, track=lost)[0], "times of the frames")
    assert (told.level, "10 frames are missing" in told.message, "dropped" in told.cause) == ("doubtful", True, True)
    for name, left in (("dx", 3e-5), ("dy", -4e-5), ("zncc", 1e-9)):
        track[name].values[120] = track[name].values[119] + left
    told = finding(judged(motion, laser, track=track)[0], "frames differ")
    assert (told.level, "frame 120 is a repeated frame" in told.cause) == ("doubtful", True)


def test_exchanged_images_are_found(motion, laser):
    track = tracked(motion.sizes["time"])
    along = motion["displacement"].values / 7.8e-5
    for first, second in ((200, 201), (30, 240)):
        track["dy"].values[:, 0] = along
        track["dy"].values[[first, second], 0] = along[[second, first]]
        told = finding(judged(motion, laser, track=track)[0], "order of the frames")
        assert (told.level, told.cause) == ("doubtful", f"frames {first} and {second} are exchanged")


def test_a_holder_that_is_seldom_found_is_doubtful(motion, laser):
    told = finding(judged(motion, laser, share=0.7)[0], "holder is found")
    assert (told.level, told.setting) == ("doubtful", "tracking.body")


@pytest.mark.parametrize(("u", "level"), [(0.01, "doubtful"), (0.06, None)])
def test_a_lens_that_is_refocused_by_more_than_its_scale_is_known_is_doubtful(motion, laser, u, level):
    track = tracked(motion.sizes["time"])
    for name in ("stretch_x", "stretch_y"):
        track[name].values[240:] += 0.05
    told = finding(judged(motion.assign_attrs(u_systematic_relative=u), laser, track=track)[0], "size of the image")
    assert (told.level, "jumps by +5.0" in told.message, "focus" in told.cause) == (level, True, level is not None)


def test_a_camera_that_is_knocked_is_doubtful_and_one_blurred_frame_is_no_other_view(motion, laser):
    track = tracked(motion.sizes["time"])
    track["dy"].values[240:] += 1.0
    told = finding(judged(motion, laser, track=track)[0], "place of the image")
    assert (told.level, "jumps by +1 px" in told.message, "knocked" in told.cause) == ("doubtful", True, True)
    blurred = tracked(motion.sizes["time"])
    blurred["stretch_x"].values[240] += 0.05
    assert judged(motion, laser, track=blurred)[0].believable == "yes"
