"""The material library: what it must reproduce, where its numbers come from, and wrong files."""

from pathlib import Path

import numpy as np
import pytest

from labpipe.contact import drop, indent
from labpipe.errors import InputError, SourceError
from labpipe.materials import load
from labpipe.materials.library._library import NAMES, STATUSES, describe


@pytest.mark.parametrize("name", NAMES)
def test_every_number_has_a_source_and_a_status(name: str) -> None:
    material = describe(name)
    assert {e.name for e in material.entries} >= {"poisson", "E_relaxed", "relaxation", "shift"}
    for entry in material.entries:
        assert len(entry.source) > 5
        assert entry.status in STATUSES


def test_nbr_gives_the_three_plateaus_of_the_thesis_from_one_modulus() -> None:
    nbr = load("nbr")
    assert nbr.E_relaxed / (1 - nbr.nu**2) == pytest.approx(10.14e6, rel=1e-3)
    for depth, plateau in ((1e-4, 12.2), (2e-4, 31.0), (3e-4, 55.5)):
        time = np.concatenate([np.linspace(0, depth / 1e-3, 50), np.geomspace(1, 600, 40)])
        pressed = indent(nbr, 2e-3, 8e-3, 18e-3, time, np.minimum(time * 1e-3, depth), elements=512)
        assert float(pressed["force"][-1]) == pytest.approx(plateau, rel=0.03)


def test_ptfe_comes_to_rest_as_the_thesis_observes() -> None:
    found = drop(load("ptfe"), 9.525e-3, 0.505, 7e-3, 0.3)
    assert float(found["impact_time"][0]) == pytest.approx(0.0378, abs=2e-4)
    assert float(found["restitution"].mean()) == pytest.approx(0.6, abs=0.05)
    assert float(found["impact_time"][-1]) == pytest.approx(0.15, abs=0.02)


GOOD = """labpipe_material = 1
name = "x"
[poisson]
value = "0.4"
source = "here"
status = "measured"
[E_relaxed]
value = "2 ± 0.1 GPa"
source = "here"
status = "measured"
[relaxation]
rho = [1e-3, 1.0]
E = [1e8, 2e8]
source = "here"
status = "measured"
[shift]
T_ref = "20 degC"
law = "arrhenius"
activation_energy = 8e4
source = "here"
status = "estimate"
"""


def test_a_file_of_the_laboratory_reads(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(GOOD, "utf-8")
    solid = load(tmp_path / "m.toml")
    assert solid.E_unrelaxed == pytest.approx(2.3e9)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ('"0.4"', '"0.4 mm"', 4, "quantity in 1"),
        ("GPa", "furlong", 8, "unknown unit"),
        ("E = [1e8, 2e8]", "E = [1e8]", 13, "1 moduli stand beside 2 times"),
        ("E = [1e8, 2e8]", "E = [1e8, -2e8]", 11, "relaxation"),
        ('status = "measured"\n[E_', 'status = "true"\n[E_', 6, "one of measured"),
        ("arrhenius", "magic", 18, '"arrhenius" or "wlf"'),
        ("labpipe_material = 1", "labpipe_material = 1\ncolour = 3", 2, "unknown"),
        ('source = "here"\nstatus = "measured"\n[shift]', 'status = "measured"\n[shift]', 11, "source: expected text"),
    ],
)
def test_a_mistake_is_named_with_its_line(tmp_path: Path, old: str, new: str, line: int, words: str) -> None:
    (tmp_path / "m.toml").write_text(GOOD.replace(old, new, 1), "utf-8")
    with pytest.raises(SourceError, match=words) as caught:
        load(tmp_path / "m.toml")
    assert f"m.toml:{line}:" in str(caught.value)


@pytest.mark.parametrize(
    ("content", "words"), [(b"a = [", "not TOML"), (b"\xff\xfe\x00", "UTF-8"), (None, "cannot be read")]
)
def test_other_files_are_refused(tmp_path: Path, content: bytes | None, words: str) -> None:
    if content is not None:
        (tmp_path / "m.toml").write_bytes(content)
    with pytest.raises(SourceError, match=words):
        load(tmp_path / "m.toml")


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(InputError, match="acrylic"):
        load("granite")


def test_a_law_is_not_stretched_beyond_its_reach() -> None:
    with pytest.raises(InputError, match="its pole lies at"):
        load("nbr", temperature=-90.0)
    with pytest.raises(InputError, match="absolute zero"):
        load("acrylic", temperature=-300.0)
