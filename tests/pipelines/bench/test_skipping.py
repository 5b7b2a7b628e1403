"""Shortcuts change nothing that matters, and save work: counts, not seconds."""

from pathlib import Path

import pytest

from labpipe import materials
from pipelines.bench import skipped_frames, skipped_steps
from pipelines.bench.skipped_frames import contact_film


def test_the_film_of_an_impact_shows_a_dark_disc_only_in_its_middle() -> None:
    film = contact_film(32)
    dark = [(frame[46:80, 54:88] < 45).mean() for frame in film]
    assert dark[16] > 0.99
    assert max(dark[:14]) < 0.9


def test_no_shortcut_of_the_simulator_changes_more_than_it_may() -> None:
    shortcut = skipped_steps.memory(60)
    assert shortcut.difference(shortcut.short(), shortcut.whole()) < 1e-2
    for shortcut in (
        skipped_steps.folded_terms("13 terms", materials.load("acrylic")),
        skipped_steps.folded_terms("80 terms", skipped_steps.many_terms()),
        skipped_steps.flights(0.15),
        skipped_steps.rest(0.4),
        skipped_steps.impacts_asked_for(0.2),
    ):
        short, whole = shortcut.short(), shortcut.whole()
        assert 0.0 <= shortcut.difference(short, whole) < 1.0
        assert shortcut.work(short) < shortcut.work(whole)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rest", "contact", "rows", "bytes", "subsets", "reference"])
def test_no_shortcut_of_a_film_changes_more_than_it_may(kind: str, tmp_path: Path) -> None:
    shortcut = {
        "rest": lambda: skipped_frames.rest_in_a_film(tmp_path, 400),
        "contact": lambda: skipped_frames.frames_without_contact(112),
        "rows": lambda: skipped_frames.rows_outside(tmp_path),
        "bytes": lambda: skipped_frames.bytes_instead_of_floats(quick=True),
        "subsets": skipped_frames.subsets_asked_for,
        "reference": lambda: skipped_frames.one_reference(5),
    }[kind]()
    short, whole = shortcut.short(), shortcut.whole()
    assert shortcut.difference(short, whole) <= 1.0
    assert shortcut.work(short) <= shortcut.work(whole)
