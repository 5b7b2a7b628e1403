"""Comparisons of measurement and model over a session: the rows of its experiments, named and labelled."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from labpipe.errors import LabpipeError
from labpipe.notebook import Shown, ShownAsTable
from labpipe.workflow.context import settings_in_words
from labpipe.workflow.fields import REFERENCE
from labpipe.workflow.graph import OTHER, field_value
from labpipe.workflow.results import Results
from labpipe.workflow.session import Experiment, Session
from pipelines.experiments import KINDS
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.session._results import derive


@dataclass(frozen=True, slots=True, repr=False)
class Comparison(ShownAsTable):
    """All rows of a session, and the experiments that failed or compare nothing, with reasons.

    ``page`` is the HTML file. ``experiments`` holds, for each that is judged as a whole, its chi
    square, and the smallest error of each input that it would have shown; ``variants`` each variant and its base.
    """

    rows: tuple[Row, ...]
    failed: dict[str, str]
    absent: dict[str, str]
    page: Path
    experiments: tuple[dict[str, Any], ...] = ()
    variants: tuple[SideBySide, ...] = ()

    def _shown(self) -> Shown:
        rows = [(r.experiment, r.condition, r.quantity, comparison_text(r)) for r in self.rows]
        rows += [(name, "", why, "") for name, why in (self.failed | self.absent).items()]
        titles = ("experiment", "condition", "quantity", "measured against model")
        return Shown(f"{len(self.rows)} comparisons, {self.page}", titles, rows)


@dataclass(frozen=True, slots=True)
class SideBySide:
    """Two experiments: the settings that differ where one is a variant, and their rows in pairs, base first."""

    name: str
    base: str
    changed: Mapping[str, tuple[str, str]]
    rows: tuple[tuple[Row, Row], ...]

    @property
    def changes(self) -> str:
        """The settings that differ, in words."""
        return settings_in_words(self.changed)

    def document(self) -> dict[str, Any]:
        """Return it for JSON."""
        rows = [{"base": old.document(), "variant": new.document()} for old, new in self.rows]
        return {"name": self.name, "base": self.base, "changed": dict(self.changed), "rows": rows}


def side_by_side(session: Session, base: str, name: str, rows: Iterable[Row]) -> SideBySide:
    """Pair the rows of two experiments that compare the same."""
    base_rows, own = ({(r.quantity, r.unit, r.against): r for r in rows if r.experiment == n} for n in (base, name))
    pairs = tuple((base_rows[key], own[key]) for key in base_rows if key in own)
    return SideBySide(name, base, session.experiments[name].changed, pairs)


def comparison_text(row: Row) -> str:
    """Write the values of a row: nRMSE and bias of a curve, both sides and the deviation of an event."""
    from labpipe.report import display_unit, number, plus_minus, quantity

    if row.nrmse is not None:
        bias = "" if row.difference is None else f", bias {quantity(row.difference, row.unit, 3)}"
        return f"nRMSE {100 * row.nrmse:.2f} %{bias}"
    shown = display_unit([value for value in (row.measured, row.model) if value is not None], row.unit)
    measured, model = (
        plus_minus(value / shown.factor, u / shown.factor) if u else number(value / shown.factor, 5)
        for value, u in ((row.measured or 0.0, row.u_measured), (row.model or 0.0, row.u_model))
    )
    deviation = "" if row.deviation is None else f", {row.deviation:+z.1f} u"
    return f"{measured} against {model}{shown.text and f' {shown.text}'}{deviation}"


def labelled(row: Row, experiment: Experiment, session: Session) -> Row:
    """Return a row with the names of its experiment and kind and, where it has none, its material and condition."""
    body = getattr(experiment.settings, KINDS[experiment.kind].body, None)
    height, temperature = getattr(experiment.settings, "height", None), getattr(body, "temperature", None)
    parts = [] if height is None else [f"{height.value * 1e3:g} mm"]
    parts += [] if temperature is None else [f"{temperature.value:g} °C"]
    material, condition = row.material or _material(experiment, session), row.condition or ", ".join(parts)
    return replace(row, experiment=experiment.name, kind=experiment.kind, material=material, condition=condition)


def compared(results: Results, name: str) -> list[Row] | None:
    """Return the comparisons of an experiment by its results; None where these are not there."""
    session = results.plan.session
    experiment = session.experiments[name]
    derived = KINDS[experiment.kind].rows
    if derived is None:
        return []
    try:
        return [labelled(row, experiment, session) for row in derive(results, experiment, derived)]
    except LabpipeError:
        return None


def _material(experiment: Experiment, session: Session) -> str:
    """Return the material of a body; of a film that names none, that of the drops it is compared with."""
    kind = KINDS[experiment.kind]
    body = getattr(experiment.settings, kind.body, None)
    texts = (getattr(body, n, None) for n in ("material", "material_from", "material_file"))
    own = next((text.removeprefix(REFERENCE) for text in texts if isinstance(text, str)), "")
    if own:
        return own
    inputs = {name.removeprefix(OTHER) for s in kind.stages for name in s.inputs if name.startswith(OTHER)}
    for field in sorted({name.split("/")[0] for name in inputs}):
        named = field_value(experiment.settings, field)
        other = session.experiments.get(named.removeprefix(REFERENCE)) if isinstance(named, str) else None
        if other is not None and other.name != experiment.name and (found := _material(other, session)):
            return found
    return ""
