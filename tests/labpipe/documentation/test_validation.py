"""The page on stated uncertainties holds a row for every kind, as its command prints them."""

from pathlib import Path

from pipelines.experiments import KINDS
from tests.pipelines import coverage

PAGE = Path(__file__).parents[3] / "labpipe/documentation/validation.md"


def rows() -> list[list[str]]:
    lines = PAGE.read_text("utf-8").split("rms error / u |\n")[1].split("\n\n")[0].splitlines()[1:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_every_kind_has_its_rows() -> None:
    assert {row[0] for row in rows()} == set(KINDS) == set(coverage.KINDS)


def test_nine_in_ten_errors_lie_in_their_intervals_but_for_chance_or_the_page_says_so() -> None:
    text = PAGE.read_text("utf-8")
    for kind, quantity, seeds, _, share, _, spread in rows():
        chance = 2 * (0.95 * 0.05 / int(seeds)) ** 0.5
        inside, _, mark = share.partition(" ")
        is_covered = float(inside) >= 0.95 - max(chance, 0.05) and float(spread) < 1.3
        assert is_covered == (mark == ""), (kind, quantity)
        assert not mark or f"\n{mark} Intervals that are too narrow: " in text
        assert float(spread) > 0.4, (kind, quantity)
