"""Every sentence of "Methods, to paste" says what was done: each page in each of its branches."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from labpipe.report import Section
from labpipe.units import Quantity
from pipelines.experiments.ball_drop import page as drop
from pipelines.experiments.contact_area import page as film
from pipelines.experiments.dic_validation import page as camera
from pipelines.experiments.dma import page as rheometer
from pipelines.experiments.harmonic import page as oscillation
from pipelines.experiments.plate_vibration import page as ringing
from pipelines.experiments.relaxation import page as relaxation
from pipelines.experiments.shared.settings import Sphere
from pipelines.experiments.static_loading import page as static

SPHERE = Sphere(radius=Quantity(9.5e-3, 5e-6, "m"), mass=Quantity(0.5, 1e-3, "kg"), material="acrylic")


@pytest.mark.parametrize(
    ("codes", "says", "hides"),
    [
        ([1, 1, 1], ("in 3 frames by fitting the interference phase", "smear"), ("edge", "interpolation")),
        ([2, 2], ("in 2 frames from the edge",), ("interference", "smear")),
        ([1, 2, 3], ("in 1 frame by fitting", "in 1 frame from the edge", "at rest by interpolation"), ()),
        ([5], ("left free",), ("edge", "smear")),
        ([4], ("in no frame",), ("edge", "interference")),
    ],
)
def test_a_film_tells_how_its_frames_were_measured(codes: list[int], says: Any, hides: Any) -> None:
    radius = xr.Dataset({"method": ("frame", codes), "in_contact": ("frame", np.ones(len(codes)))})
    impacts = xr.Dataset({"peak_radius": ("impact", [])})
    settings: Any = SimpleNamespace(sphere=SPHERE, wavelength=Quantity(633e-9, 0.0, "m"))
    _holds(film._methods(settings, radius, impacts), says, hides)


@pytest.mark.parametrize(
    ("has_model", "says", "hides"),
    [
        (True, ("quintic smoothing spline", "on sapphire of E", "“acrylic”"), ()),
        (False, (), ("simulated", "root-mean-square")),
    ],
)
def test_a_drop_simulates_only_what_was_simulated(has_model: bool, says: Any, hides: Any) -> None:
    settings: Any = SimpleNamespace(
        sphere=SPHERE,
        laser=["a.csv"],
        height=Quantity(1.5e-3, 5e-6, "m"),
        model=SimpleNamespace(profile="sphere", rtol=1e-4),
        counter_body="sapphire",
    )
    one = {"units": "1"}
    repeats = xr.Dataset({"restitution": ("impact", [0.9], one), "u_restitution": ("impact", [1e-3], one)})
    _holds(drop._methods(settings, repeats, model=xr.Dataset() if has_model else None), says, hides)


@pytest.mark.parametrize(
    ("punch", "touch", "how", "says", "hides"),
    [
        (
            object(),
            1e-3,
            "fitted to the force of the Find Contact block, with the cell's filter",
            ("a periodic punch", "First touch was fitted to the force of the Find Contact block"),
            (),
        ),
        (None, np.nan, "the file holds no Find Contact block", ("a punch",), ("periodic", "First touch")),
        (object(), 1e-3, "given in session.toml", ("First touch was given",), ("fitted",)),
    ],
)
def test_a_relaxation_names_its_punch_and_how_touch_was_found(
    punch: object, touch: float, how: str, says: Any, hides: Any
) -> None:
    tests = xr.Dataset({name: ("test", [1e-3]) for name in ("depth", "speed", "duration")})
    ramps = [xr.Dataset({"contact_position": touch}, attrs={"contact": how})]
    settings: Any = SimpleNamespace(punch=punch)
    text = relaxation._methods(settings, tests, ramps)
    _holds(text, says, (*hides, "simulated"))


def test_a_film_without_a_laser_is_not_compared_with_one() -> None:
    settings: Any = SimpleNamespace(view="side")
    track = xr.Dataset({"subset": ("frame", [41])})
    _holds(camera._methods(settings, track), ("digital image correlation",), ("laser", "Bland"))
    assert not camera.page.counts["comparison"](xr.Dataset())


@pytest.mark.parametrize(
    ("asked", "mode", "says", "hides"),
    [
        ("free", "tension", ("every isotherm had a shift of its own",), ("the shifts followed", "2 (1 + ν) G")),
        ("wlf", "shear", ("the shifts followed the WLF law", "2 (1 + ν) G with ν = 0.35"), ("of its own",)),
        ("arrhenius", "bending", ("the shifts followed the Arrhenius law",), ("of its own", "2 (1 + ν) G")),
    ],
)
def test_a_rheometer_tells_what_its_shifts_followed_and_where_tension_comes_from(
    asked: str, mode: str, says: Any, hides: Any
) -> None:
    law = {"name": "wlf", "T_ref": 20.0, "parameters": [0.1, 0.01], "C1": 10.0, "u_C1": 0.1, "C2": 100.0, "u_C2": 1.0}
    curve = xr.Dataset(
        {"T_ref": 20.0, "storage_residual": ("point", [0.01, -0.01]), "loss_residual": ("point", [0.02, np.nan])},
        coords={"temperature": [0.0, 20.0, 40.0]},
        attrs={"law": json.dumps(law | {"chi_square": 2.0, "freedom": 2}), "vertical_law": "none"},
    )
    settings: Any = SimpleNamespace(mode=mode, nu=Quantity(0.35, 0.0, "1"), fit=SimpleNamespace(law=asked))
    text = rheometer._methods(settings, curve)
    _holds(text, (*says, "at 3 temperatures", "1.00 % (E′) and 2.00 % (E″)"), hides)


@pytest.mark.parametrize(
    ("errors", "is_late", "says", "hides"),
    [
        ([0.02, 0.03], 1, ("2 frequencies, 0.5 to 2 Hz", "delay of the load cell", "was 2.00 to 3.00 %"), ()),
        ([0.02], 0, ("1 frequency, 0.5 Hz", "the first 1 cycle and", "was 2.00 %"), ("delay", "0.5 to", "2.00 to")),
        ([], 0, ("2 frequencies, 0.5 to 2 Hz",), ("simulated", "error", "delay")),
    ],
)
def test_an_oscillation_tells_its_frequencies_and_a_model_where_there_is_one(
    errors: list[float], is_late: int, says: Any, hides: Any
) -> None:
    settings: Any = SimpleNamespace(cycles=SimpleNamespace(skip=1))
    waves = xr.Dataset({"frequency": ("block", [0.5, 2.0][: len(errors) or 2])}, attrs={"is_filter_corrected": is_late})
    made = xr.Dataset({"nrmse": ("block", errors)}) if errors else None
    _holds(oscillation._methods(settings, waves, made), says, hides)


@pytest.mark.parametrize(
    ("reference", "says", "hides"),
    [
        ("relaxed modulus", ("1, 2 kg at 0.00, 10.00 min", "touch was fitted", "Hertz with the relaxed"), ()),
        ("", ("The contact radius is",), ("error", "simulation", "Hertz")),
    ],
)
def test_a_static_loading_tells_what_it_was_compared_with(reference: str, says: Any, hides: Any) -> None:
    loads = [SimpleNamespace(mass=Quantity(mass, 0.0, "kg")) for mass in (1.0, 2.0)]
    settings: Any = SimpleNamespace(loads=loads, sphere=SPHERE, counter_body="rigid")
    steps, approach = xr.Dataset({"begin": ("load", [0.0, 600.0])}), xr.Dataset(coords={"time": [0.0, 5.0, 10.0]})
    errors = {f"nrmse_contact_radius_{of}": 0.01 for of in ("model", "hertz")}
    made = xr.Dataset(errors, attrs={"reference": reference}) if reference else None
    _holds(static._methods(settings, steps, approach, made), says, hides)


@pytest.mark.parametrize(("mass", "says", "hides"), [(30.0, ("The modal mass, ",), ()), (np.nan, (), ("modal mass",))])
def test_a_plate_tells_a_mass_only_where_it_has_one(mass: float, says: Any, hides: Any) -> None:
    told = {"plate_natural_frequency": (200.0, "Hz"), "plate_damping_ratio": (0.03, "1")}
    table = xr.Dataset({name: ((), value, {"units": unit}) for name, (value, unit) in told.items()})
    table = table.assign({f"u_{name}": 0.001 for name in told}).assign(n=("series", [2, 1]))
    plate = xr.Dataset({"mass": ((), mass, {"units": "kg"}), "u_mass": 0.5})
    settings: Any = SimpleNamespace(drops=[SimpleNamespace(material=name) for name in ("ptfe", "nylon", "ptfe")])
    _holds(ringing._methods(settings, table, plate), (*says, "spheres (nylon, ptfe)", "in 3 recordings"), hides)


def _holds(section: Section, says: tuple[str, ...], hides: tuple[str, ...]) -> None:
    (folded,) = section.blocks
    (paragraph,) = folded.blocks
    text = paragraph.text
    assert [words for words in says if words not in text] == [], text
    assert [words for words in hides if words in text] == [], text
    assert text.strip().endswith(".")
