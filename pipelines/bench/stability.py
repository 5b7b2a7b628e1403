"""Extreme input: error against an independent result, and refusals with their reasons."""

from collections import Counter
from collections.abc import Mapping

from pipelines.bench import (
    stability_bounces,
    stability_calibration,
    stability_contact,
    stability_films,
    stability_impact,
    stability_materials,
    stability_signals,
)
from pipelines.bench.measure import Point, Suite
from pipelines.bench.stability_outcome import Case, Tally, run_family

#: Module by module, families of cases with how many of them the tests try.
FAMILIES: Mapping[str, Mapping[str, tuple[Case, int]]] = {
    "contact": stability_contact.FAMILIES,
    "impact": stability_impact.FAMILIES,
    "signals": stability_signals.FAMILIES,
    "bounces": stability_bounces.FAMILIES,
    "films": stability_films.FAMILIES,
    "materials": stability_materials.FAMILIES,
    "calibration": stability_calibration.FAMILIES,
}
#: What a full and a quick run try, in multiples of what the tests try.
_FULL, _QUICK = 10, 0.1
#: Refusals that are listed per suite.
_MOST_REASONS = 12


def run(quick: bool) -> list[Suite]:
    """Try hostile cases of every part.

    Parameters
    ----------
    quick : bool
        Some seven hundred cases; otherwise some seventy thousand.

    Returns
    -------
    list of Suite
        One suite per part: a row per family with the error of its worst case in units of the bound
        that is allowed (right up to 1), the cases tried, right, refused and wrong, and the slowest
        case in s. The notes count the reasons of refusals.
    """
    factor = _QUICK if quick else _FULL
    return [_suite(part, families, factor) for part, families in FAMILIES.items()]


def _suite(part: str, families: Mapping[str, tuple[Case, int]], factor: float) -> Suite:
    tallies = {name: run_family(case, max(1, round(factor * count))) for name, (case, count) in families.items()}
    tried = sum(tally.tried for tally in tallies.values())
    wrong = sum(len(tally.wrong) for tally in tallies.values())
    refused: Counter[str] = sum((tally.refused for tally in tallies.values()), Counter())
    notes = [
        f"{tried} cases: {tried - wrong - refused.total()} right, {refused.total()} refused "
        f"with a reason, {wrong} wrong."
    ]
    notes += [f"refused {n} times: {why}" for why, n in refused.most_common(_MOST_REASONS)]
    notes += [
        f"wrong in {name}: seeds {list(tally.wrong)}, {tally.worst_bound}"
        for name, tally in tallies.items()
        if tally.wrong
    ]
    return Suite(
        name=f"stability-{part}",
        title=f"Extreme input to {part}: worst case against an independent result",
        error_label="worst error over what is allowed (1)",
        points=[_point(name, tally) for name, tally in tallies.items()],
        notes=notes,
        has_diagram=False,
    )


def _point(name: str, tally: Tally) -> Point:
    # What must never happen has an infinite share, which no diagram can hold.
    share = min(tally.worst_share, float(len(tally.wrong) + 1e9))
    return Point(
        setting=name,
        error=share,
        seconds=tally.slowest,
        extra={
            "tried": tally.tried,
            "right": tally.right,
            "refused": tally.refused.total(),
            "wrong": len(tally.wrong),
            "nearest bound": tally.worst_bound,
        },
    )
