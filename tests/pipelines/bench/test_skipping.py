"""Shortcuts change nothing that matters, and save work: counts, not seconds."""

from pathlib import Path

import pytest

from labpipe import materials
from pipelines.bench import skipping
from pipelines.bench.skipping import contact_film


def test_the_film_of_an_impact_shows_a_dark_disc_only_in_its_middle() -> None:
    film = contact_film(32)
    dark = [(frame[46:80, 54:88] < 45).mean() for frame in film]
    assert dark[16] > 0.99
    assert max(dark[:14]) < 0.9


def test_no_shortcut_of_the_simulator_changes_more_than_it_may() -> None:
    shortcut = skipping._memory(60)
    assert shortcut.difference(shortcut.short(), shortcut.whole()) < 1e-2
    for shortcut in (
        skipping._folded_terms("13 terms", materials.load("acrylic")),
        skipping._folded_terms("80 terms", skipping._many_terms()),
        skipping._flights(0.15),
        skipping._springs_out_of_reach(0.06),
        skipping._rest(0.4),
        skipping._impacts_asked_for(0.2),
    ):
        short, whole = shortcut.short(), shortcut.whole()
        assert 0.0 <= shortcut.difference(short, whole) < 1.0
        assert shortcut.work(short) < shortcut.work(whole)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rest", "contact", "rows", "bytes", "subsets", "reference"])
def test_no_shortcut_of_a_film_changes_more_than_it_may(kind: str, tmp_path: Path) -> None:
    shortcut = {
        "rest": lambda: skipping._rest_in_a_film(tmp_path, 400),
        "contact": lambda: skipping._frames_without_contact(112),
        "rows": lambda: skipping._rows_outside(tmp_path),
        "bytes": lambda: skipping._bytes_instead_of_floats(quick=True),
        "subsets": skipping._subsets_asked_for,
        "reference": lambda: skipping._one_reference(5),
    }[kind]()
    short, whole = shortcut.short(), shortcut.whole()
    assert shortcut.difference(short, whole) <= 1.0
    assert shortcut.work(short) <= shortcut.work(whole)
