"""The page on stated uncertainties holds a row for every kind, as its command prints them."""

from pathlib import Path

from pipelines.experiments import KINDS
from tests.pipelines import coverage

PAGE = Path(__file__).parents[3] / "labpipe/documentation/evidence.md"


def rows() -> list[list[str]]:
    lines = PAGE.read_text("utf-8").split("rms error / u|\n")[1].split("\n\n")[0].splitlines()[1:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_every_kind_has_its_rows() -> None:
    assert {row[0] for row in rows()} == set(KINDS) == set(coverage.KINDS)


def test_intervals_hold_the_truth_as_often_as_they_say_but_for_chance() -> None:
    for kind, quantity, seeds, share, spread in rows():
        chance = 2 * (0.95 * 0.05 / int(seeds)) ** 0.5
        assert float(share) >= 0.95 - max(chance, 0.05), (kind, quantity)
        assert 0.4 < float(spread) < 1.3, (kind, quantity)
