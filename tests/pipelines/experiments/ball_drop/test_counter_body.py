"""A drop on sapphire of the rig: analysed as on sapphire it agrees, as on a rigid flat it is biased."""

import json
from pathlib import Path

import numpy as np
import pytest

from labpipe import contact, materials
from pipelines.rig.drops import DropRig, write_drops
from pipelines.rig.samples import STATED_FLOOR
from pipelines.rig.session_text import drop_section, laser_record
from pipelines.session import result
from tests.pipelines.sessions import begun, page_of, processed
from tests.pipelines.small import START

HEIGHT = 5e-3
FLATS = {"sapphire": "", "rigid": 'counter_body = "rigid"\n'}


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flats")
    names = write_drops(folder, "drop", DropRig(duration=0.12), materials.load("acrylic"), HEIGHT, 1, 8, START)
    sections = (drop_section(name, names, HEIGHT, "acrylic", STATED_FLOOR + flat) for name, flat in FLATS.items())
    return processed(begun(folder, "".join(sections), laser=laser_record()))


def test_only_the_rigid_flat_is_biased(session: Path) -> None:
    for name, model in (("sapphire", "agrees"), ("rigid", "differs")):
        made = result(session, name, "comparison")
        deviation = abs(float(made["restitution_difference"][0] / made["u_restitution_difference"][0]))
        assert (deviation < 3.0) == (name == "sapphire")
        assert result(session, name, "judgement").attrs["model"] == model


def test_its_modulus_stands_in_the_budget_with_the_slope_of_a_new_simulation(session: Path) -> None:
    (row,) = (r for r in json.loads(result(session, "sapphire", "model").attrs["budget"]) if "sapphire" in r["source"])
    assert (row["value"], row["u"]) == (403e9, 10e9)
    flats = [(E, 0.235) for E in (300e9, 600e9)]
    fall = ("acrylic", 9.525e-3, 0.505, HEIGHT, 0.034)
    moved = contact.impacts(*fall, plate=contact.Plate(1450.0, 390.0, 0.03), substrate=flats, rtol=1e-6)
    slope = float(np.diff(moved["restitution"].values[:, 0])[0]) / (1 / 600e9 - 1 / 300e9) / -(403e9**2)
    assert row["sensitivity"] == pytest.approx(slope, rel=0.1)


def test_the_page_says_what_it_lies_on_and_where_linearity_ends(session: Path) -> None:
    page = page_of(session, "sapphire")
    for words in ("sapphire of E = (403 ± 10) GPa and ν = 0.235", "acrylic begins to yield at 1.6 Y", "0.2 a/R"):
        assert words in page
    made = result(session, "sapphire", "model")
    known, stress = json.loads(made.attrs["linear_range"]), materials.describe("acrylic").yield_stress
    force, radius = (float(made[name][0]) for name in ("peak_force", "peak_contact_radius"))
    assert known["pressure"] == pytest.approx(1.5 * force / np.pi / radius**2)
    assert known["onset"] == pytest.approx(1.6 * (stress.value + 15e6 * np.log10(known["rate"] / 1e-3)))
