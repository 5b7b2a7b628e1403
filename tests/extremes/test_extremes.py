"""Hostile input to every part: right within a stated bound, or refused with a reason.

Each case is made from its seed alone, so that a failure names the seeds that show it again.
"""

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

import labpipe
from tests.extremes import bounces, contact, films, impact, materials, plates, signals
from tests.extremes.outcome import Case, run_case, run_family

#: Module by module, families of cases with how many of them are tried.
FAMILIES: Mapping[str, Mapping[str, tuple[Case, int]]] = {
    "contact": contact.FAMILIES,
    "impact": impact.FAMILIES,
    "plates": plates.FAMILIES,
    "signals": signals.FAMILIES,
    "bounces": bounces.FAMILIES,
    "films": films.FAMILIES,
    "materials": materials.FAMILIES,
}
#: Of families of films and long histories, so many cases by `-m slow`; all of them by `-m nightly`.
FEWER = {"moved pattern": 40, "any drop": 12, "seen contact": 4, "no contact": 4, "velocity of a polynomial": 12}
CASES = [(part, name) for part, families in FAMILIES.items() for name in families]
# At most this share of a family may be refused, so that what is easy to refuse is computed too.
REFUSED = {"no bounce": 1.0, "any drop": 0.5, "springs and rings": 0.4}
REFUSED |= {"any drop on a plate": 0.5, "springs and rings on a plate": 0.45}


@pytest.mark.slow
@pytest.mark.parametrize(("part", "name"), CASES)
def test_every_case_is_right_or_refused_with_a_reason(part: str, name: str, amount: Callable[[int, int], int]) -> None:
    case, count = FAMILIES[part][name]
    count = amount(FEWER.get(name, count), count)
    tally = run_family(case, count)
    assert tally.wrong == (), tally.worst
    assert tally.right + tally.refused.total() == count
    assert tally.refused.total() <= REFUSED.get(name, 0.2) * count, tally.refused
    assert all(len(reason) > 5 for reason in tally.refused)


@pytest.mark.parametrize("seed", [111, 319])
def test_a_contact_whose_surface_follows_the_sphere_is_one_impact(seed: int) -> None:
    assert run_case(plates.plate_by_two_solvers, seed).share <= 1.0


@pytest.mark.nightly
def test_two_thousand_drops_on_plates_are_right_or_refused() -> None:
    tally = run_family(plates.any_drop_on_a_plate, 2000)
    assert tally.wrong == (), tally.worst
    assert tally.right >= 1000


def test_the_guide_says_how_many_cases_are_tried() -> None:
    count = 2000 + sum(count for families in FAMILIES.values() for _, count in families.values())
    page = Path(labpipe.__file__).parent / "documentation/evidence.md"
    assert f"| {count:,}: none silently wrong |" in page.read_text("utf-8")
