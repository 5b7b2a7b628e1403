"""The page of budgets and sensitivities of one kind of experiment."""

from collections.abc import Sequence
from math import isinf

from labpipe.report import Bars, Block, Column, Details, Paragraph, Section, Table, shown_source
from labpipe.uncertainty import inputs_to_halve
from labpipe.workflow.session import Session
from pipelines.experiments import KINDS
from pipelines.experiments.shared import budget_blocks as budget_drawing
from pipelines.experiments.shared.budget_blocks import half_width, overview
from pipelines.experiments.shared.pages import session_document, synthetic_notice
from pipelines.session._examined import Examined

_BEST = 20.0  # factor beyond which "better" means "exactly"
_NO_SCALE = ("degC", "1")  # units in which a share of the value says little
_SMALL = 0.5  # of the value: beyond, a result is about nothing
_BARS, _SHOWN = 2, 0.05  # bars of a quantity, and the least share that has one
_ALIKE = 0.05  # of the variance: shares that differ by less tell the same


def render(session: Session, kind: str, found: Sequence[Examined]) -> str:
    """Return the page of the quantities of one kind of experiment as HTML text."""
    head = synthetic_notice(session)
    sections = [Section("What to measure better", (Paragraph(answer(found)), *head, *answers(found)))]
    for name in dict.fromkeys(e.experiment for e in found):
        own = [e for e in found if e.experiment == name]
        folded = tuple(Details(e.quantity.name, blocks=budget_blocks(e)) for e in own)
        sections.append(Section(name, (*summary(own), *folded)))
    return session_document(session, f"Uncertainty and sensitivity: {KINDS[kind].title}", sections)


def total_shares(found: Examined) -> dict[str, float]:
    """Return Sobol's total indices, scaled to a sum of one."""
    total = sum(i.total for i in found.indices.values()) or 1.0
    return {name: i.total / total for name, i in found.indices.items()}


def advice(found: Examined) -> str:
    """Say what to measure better to halve the uncertainty."""
    if found.budget.u == 0.0:
        return "no input is uncertain"
    names, factor = inputs_to_halve(total_shares(found))
    return _known_better(names, factor)


def _known_better(names: Sequence[str], factor: float) -> str:
    *others, last = map(shown_source, names)
    text = f"{', '.join(others)} and {last}" if others else last
    if isinf(factor) or factor > _BEST:
        return f"know {text} exactly"
    return f"know {text} {factor:.2g} times better"


def families(found: Sequence[Examined]) -> dict[str, list[Examined]]:
    """Gather what has the same sense, in all experiments and impacts; nothing that is exact."""
    groups: dict[str, list[Examined]] = {}
    for each in found:
        if each.budget.u > 0.0:
            groups.setdefault(each.quantity.family or each.quantity.name, []).append(each)
    return groups


def mean_shares(group: Sequence[Examined]) -> dict[str, float]:
    """Return the mean share of every input over quantities of the same sense."""
    names = dict.fromkeys(name for e in group for name in e.indices)
    return {n: sum(total_shares(e).get(n, 0.0) for e in group) / len(group) for n in names}


def answer(found: Sequence[Examined]) -> str:
    """Say in one sentence what to measure better, and then whether both ways say so."""
    parts = []
    for name, group in families(found).items():
        names, factor = inputs_to_halve(mean_shares(group))
        parts.append(f"of the {name}, {_known_better(names, factor)}")
    first = f"To halve the uncertainty {'; '.join(parts)}." if parts else "Nothing is uncertain."
    return f"{first} {agreement(found)}"


def agreement(found: Sequence[Examined]) -> str:
    """Say how far linear shares and Sobol indices differ, and why."""
    gaps = {e: _gap(e) for e in found if e.budget.u > 0.0}
    apart = [e for e, gap in gaps.items() if gap > _ALIKE]
    if not apart:
        return (
            "Linear shares of the variance and Sobol's total indices agree within "
            f"{100.0 * max(gaps.values(), default=0.0):.1g} % of the variance."
        )
    names = ", ".join(f"{e.experiment}, {e.quantity.name} ({100 * gaps[e]:.0f} %)" for e in apart)
    return (
        "Linear shares of the variance and Sobol's total indices differ where the result is "
        f"nonlinear within the uncertainty of an input: {names}. Use Sobol's there."
    )


def _gap(found: Examined) -> float:
    sobol = total_shares(found)
    return max(abs(r["share"] - sobol.get(r["source"], 0.0)) for r in found.budget.rows)


def answers(found: Sequence[Examined]) -> tuple[Block, ...]:
    """Return what limits each sort of quantity: its largest shares as bars, and one row each."""
    bars, rows = [], []
    for name, group in families(found).items():
        shares = mean_shares(group)
        order = sorted(shares, key=lambda n: -shares[n])
        bars += [(f"{name}: {shown_source(n)}", min(shares[n], 1.0), "") for n in order[:_BARS] if shares[n] >= _SHOWN]
        shown = (f"{shown_source(n)} {100.0 * shares[n]:.0f} %" for n in order[:3] if shares[n] >= 0.01)
        rows.append((name, len(group), _spread(group), ", ".join(shown), _known_better(*inputs_to_halve(shares))))
    limiting = "limiting inputs, mean share of the variance"
    titles = ("quantity", "results", "expanded uncertainty, 95 %", limiting, "to halve it")
    table = Table(tuple(map(Column, titles)), rows, sortable=False)
    caption = "Shares of the variance: Sobol's total indices, averaged over the results."
    chart = Bars("The inputs that limit each quantity", bars, caption)
    return (*([chart] if bars else []), table)


def _spread(group: Sequence[Examined]) -> str:
    """Write least and largest expanded uncertainty; in % where there is a value to compare with."""
    ordered = sorted(group, key=lambda e: e.budget.expanded())
    relative = sorted(e.budget.expanded() / abs(e.budget.value) for e in group if e.budget.value)
    is_scale = group[0].quantity.unit not in _NO_SCALE
    if is_scale and len(relative) == len(group) and relative[-1] < _SMALL:
        ends = [f"{100.0 * relative[i]:.2g} %" for i in (0, -1)]
    else:
        ends = [half_width(ordered[i].budget, ordered[i].quantity.unit) for i in (0, -1)]
    return " to ".join(dict.fromkeys(ends))


def summary(found: Sequence[Examined]) -> tuple[Block, ...]:
    """Return the quantities of one experiment as one table."""
    propagated = [(e.quantity, e.budget, e.drawn) for e in found]
    return (overview(propagated, "to halve the uncertainty", [advice(e) for e in found]),)


def budget_blocks(found: Examined) -> tuple[Block, ...]:
    """Return budget, bars, and how linear, Monte Carlo and Sobol compare, for any page."""
    columns = {
        "Sobol, alone": {name: _percent(i.first) for name, i in found.indices.items()},
        "Sobol, in all": {name: _percent(i.total) for name, i in found.indices.items()},
    }
    made = budget_drawing.blocks(found.quantity, found.budget, found.drawn, columns)
    return Paragraph(f"To halve the uncertainty: {advice(found)}."), *made


def _percent(share: float) -> str:
    """Write a share; an estimated one may lie a little below zero."""
    return f"{100.0 * max(share, 0.0):.1f} %"
