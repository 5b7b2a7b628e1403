"""``import labpipe as lp``: every command has a verb, typed, documented, loaded on first use."""

import inspect
import json
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import labpipe as lp
from labpipe.errors import InputError
from labpipe.materials import describe
from labpipe.units import Quantity, si
from pipelines.cli import COMMANDS

ONLY_TYPED = {"acquire", "bench", "completion", "simulate"}
"""Commands of the terminal alone: a live sensor, the benchmark, the shell; simulators are verbs."""
OBJECTS = {"MasterCurve", "Prony"}


def asked(code: str, **environment: str) -> str:
    given = os.environ | environment
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=given)
    return done.stdout.strip()


def test_a_plan_has_the_same_order_in_every_run() -> None:
    session = Path(__file__).parents[2] / "sample_data/thesis-small"
    code = f"from pipelines.session import plan; print([str(row.task) for row in plan({str(session)!r}).rows])"
    assert len({asked(code, PYTHONHASHSEED=seed) for seed in ("1", "2", "3")}) == 1


def test_every_command_has_a_verb_of_its_name() -> None:
    assert set(COMMANDS) - ONLY_TYPED <= set(dir(lp))
    assert dir(lp) == sorted(lp.__all__)
    assert {"read", "result", "results", "report", "drop", "indent", "material", "track",
            "contact_radius", "velocity", "master_curve", *OBJECTS} <= set(dir(lp))  # fmt: skip


@pytest.mark.parametrize("name", sorted(lp.__all__))
def test_a_public_name_is_typed_and_documented(name: str) -> None:
    verb = getattr(lp, name)
    text = inspect.getdoc(verb) or ""
    assert re.match(r"[A-Z`].*\.\n", text), text[:80]
    if name in OBJECTS:
        return
    for section in ("Parameters", "Returns", "Examples"):
        assert re.search(rf"^{section}( over .*)?\n-+$", text, re.M), section
    signature = inspect.signature(verb)
    assert signature.return_annotation is not inspect.Signature.empty
    assert all(p.annotation is not inspect.Parameter.empty for p in signature.parameters.values())
    assert all(re.search(rf"^(\w+, )*\*{{0,2}}{p}(, \*{{0,2}}\w+)*( :|$)", text, re.M) for p in signature.parameters)
    assert not re.search(r"numpy\._typing|collections\.abc|pathlib\.", str(signature))


def test_the_door_opens_without_any_numerical_library() -> None:
    code = "import labpipe as lp, sys; dir(lp); print([m for m in {} if m in sys.modules])"
    heavy = ["numpy", "xarray", "click", "msgspec", "instruments", "pipelines"]
    assert asked(code.format(heavy)) == "[]"


def test_comparing_stored_results_needs_no_compiler() -> None:
    code = (
        "import sys, pipelines.experiments.ball_drop.comparison, pipelines.experiments.harmonic.comparison;"
        "print(sorted({'numba', 'scipy.signal', 'scipy.stats', 'matplotlib'} & set(sys.modules)))"
    )
    assert asked(code) == "[]"


def test_texts_with_units_equal_numbers_in_si() -> None:
    acrylic = lp.material("acrylic")
    written = lp.drop("acrylic", "9.525 mm", "505 g", "1.5 mm", "30 ms", gravity="9.81 m/s2")
    plain = lp.drop(acrylic, 9.525e-3, 0.505, 1.5e-3, 0.03)
    assert written.drop_attrs().equals(plain.drop_attrs())
    assert acrylic == describe("acrylic").prony == lp.material(describe("acrylic"))
    time, depth = [0.0, 1.0], [0.0, 1e-4]
    pressed = lp.indent("nbr", "2 mm", "8 mm", "18 mm", time, depth, elements=64)
    same = lp.indent(lp.material("nbr"), 2e-3, 8e-3, 18e-3, time, depth, elements=64)
    xr.testing.assert_allclose(pressed, same, rtol=1e-9)  # 18 * 1e-3 rounds otherwise than 18e-3


@pytest.mark.parametrize(
    ("given", "unit", "expected"),
    [("4.1 um/px", "m or m/px", 4.1e-6), ("4.1 um", "m or m/px", 4.1e-6), (np.float64(2), "m", 2),
     (Quantity(0.5, 0.0, "kg"), "kg", 0.5), ("39 °C", "degC", 39.0), (np.inf, "m", np.inf)],
)  # fmt: skip
def test_a_quantity_is_a_number_a_text_or_a_pair(given, unit: str, expected: float) -> None:
    assert si(given, unit, "x") == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("given", "message"),
    [("9.525", r'radius: "9.525" has no unit; expected a number in m, .* such as "9.5 mm"'),
     ("505 g", r'radius: "505 g" is in kg; expected a number in m'),
     (Quantity(1.0, 0.0, "s"), "radius: 1 s is in s; expected a number in m"),
     ("9.525 inches", 'radius: unknown unit "inches"'),
     ("9.525 ± 0.005 mm", "states an uncertainty, and one computation does not propagate it"),
        (None, "drop needs radius as well")],
)  # fmt: skip
def test_a_wrong_quantity_is_refused_by_the_name_of_its_argument(given, message: str) -> None:
    with pytest.raises(InputError, match=message):
        lp.drop("acrylic", given, 0.5, 1e-3, 0.1)


def test_a_prony_series_has_no_temperature_and_wrong_materials_are_refused() -> None:
    assert lp.material("acrylic", "39 °C") == describe("acrylic").at(39.0)
    with pytest.raises(InputError, match="no law of temperature"):
        lp.material(lp.material("acrylic"), "39 °C")
    with pytest.raises(InputError, match=r'there is no material "acryl" in the library; known are nbr, acrylic'):
        lp.drop("acryl", "9.5 mm", "0.5 kg", "1 mm", "0.1 s")
    with pytest.raises(InputError, match=r"material: expected a name \(nbr, .*\), a .toml file, or a Prony series"):
        lp.material(3.2e9)


def test_millimetres_given_as_metres_are_warned_of_with_the_text_to_use() -> None:
    expected = 'sphere of 9.525 m; .* radius="9.525 mm", mass="505 g", height="7 mm"'
    with pytest.warns(UserWarning, match=expected):
        lp.drop("acrylic", radius=9.525, mass=505, height=7, duration=0.5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lp.drop("acrylic", radius="9.525 m", mass="505 kg", height="7 m", duration=0.5)


def test_verbs_on_a_session_show_what_they_found(processed_session: Path, tmp_path: Path) -> None:
    session = processed_session
    assert "steps would run" in repr(lp.plan(session))
    done = lp.process(session, jobs=0)
    assert f"{len(done.outcomes)} cached" in repr(done)
    found = lp.inspect(session / "laser/drop_1.csv")
    assert json.loads(json.dumps(found))["reader"] == "keyence"
    assert "keyence" in repr(found)
    exported = lp.export(session, "json", only="drop", stages="repeats", out=tmp_path)
    assert [path.name for path in exported.paths] == ["drop.repeats.json"]
    table = lp.catalogue(session, tmp_path / "all.sqlite", where="kind = 'ball_drop'")
    assert list(table.table["experiment"]) == ["drop"]
    health = lp.doctor(session)
    assert health.damaged_results == ()
    for each in (done, found, exported, table, health, lp.plan(session)):
        assert "<table>" in each._repr_html_()
    judged = lp.verdict(session, jobs=0)
    for one in judged.experiments:
        assert f"<td>{one.experiment}</td><td>{one.believable}</td><td>{one.model}</td>" in judged._repr_html_()
