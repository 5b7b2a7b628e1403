"""A heated sphere: the model with the shifted material agrees, the one of the cold does not."""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

from labpipe import materials
from labpipe.units import Quantity
from pipelines.rig.drops import DropRig, write_drops
from pipelines.rig.plate import PLATE
from pipelines.rig.session_text import drop_section, laser_record
from pipelines.session import result
from tests.pipelines.sessions import begun, processed, settings_of
from tests.pipelines.small import START

HEIGHT, HEATED, COOL = 5e-3, 39.0, Quantity(20.0, 0.5, "degC")
ON_PLATE = 'plate = { mass = "30 kg", frequency = "180 Hz", damping_ratio = 0.03 }\n'


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("heated")
    solid = materials.load("acrylic", temperature=HEATED)
    rig = DropRig(duration=0.15, floor=PLATE)
    names = write_drops(folder, "drop", rig, solid, HEIGHT, 1, 8, START)
    section = drop_section("heated", names, HEIGHT, "acrylic", ON_PLATE)
    section += f'temperature = "{HEATED:g} ± 0.5 degC"\nhomogeneous = true\n'
    surface = section.replace("experiments.heated", "experiments.surface").replace("homogeneous = true\n", "")
    cold = drop_section("cold", names, HEIGHT, "acrylic", ON_PLATE)
    return processed(begun(folder, section + surface + cold, laser=laser_record()), ["comparison"])


def test_the_shifted_material_agrees_and_the_cold_one_does_not(session: Path) -> None:
    found = {name: result(session, name, "comparison") for name in ("heated", "cold")}
    z = {
        name: float(np.abs(made["restitution_difference"] / made["u_restitution_difference"])[0])
        for name, made in found.items()
    }
    assert z["heated"] < 3 < z["cold"]
    assert float(found["heated"]["nrmse"]) < 0.01
    assert float(found["cold"]["nrmse"]) > 3 * float(found["heated"]["nrmse"])


def test_a_surface_warmer_than_the_room_widens_the_prediction(session: Path) -> None:
    """The inside may have any temperature between: a rectangle from 39 to 23 °C, on one side of the surface."""
    warm, surface = (result(session, name, "model") for name in ("heated", "surface"))
    budgets = ({row["source"]: row["u"] for row in json.loads(made.attrs["budget"])} for made in (warm, surface))
    expected = 0.5, np.hypot(0.5, (HEATED - 23.0) / np.sqrt(3.0))
    assert tuple(rows["temperature"] for rows in budgets) == pytest.approx(expected)
    assert float(surface["u_restitution"][0]) > 3 * float(warm["u_restitution"][0])
    np.testing.assert_array_equal(surface["displacement"], warm["displacement"])
    room = msgspec.structs.replace(settings_of(session, "surface").sphere, temperature=COOL)
    assert room.inside == COOL
