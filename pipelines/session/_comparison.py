"""What a comparison of measurement and model found, and how it shows itself."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from labpipe.errors import LabpipeError
from labpipe.notebook import Shown, ShownAsTable
from labpipe.workflow.fields import REFERENCE
from labpipe.workflow.graph import OTHER
from labpipe.workflow.results import Results
from labpipe.workflow.session import Experiment, Session
from labpipe.workflow.tasks import field_value
from pipelines.experiments import KINDS
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.session._results import derive


@dataclass(frozen=True, slots=True, repr=False)
class Comparison(ShownAsTable):
    """All rows of a session, and the experiments that failed or compare nothing, with reasons.

    ``page`` is the HTML file. ``experiments`` says of each that is judged as a whole how its chi
    square came out, and the smallest error of each input that it would have shown.
    """

    rows: tuple[Row, ...]
    failed: dict[str, str]
    absent: dict[str, str]
    page: Path
    experiments: tuple[dict[str, Any], ...] = ()

    def _shown(self) -> Shown:
        rows: list[tuple[str, ...]] = [
            (r.experiment, r.condition, r.quantity, *_pair(r), _agreement(r)) for r in self.rows
        ]
        rows += [(name, "", why, "", "", "") for name, why in (self.failed | self.absent).items()]
        titles = ("experiment", "condition", "quantity", "measured", "model", "agreement")
        return Shown(f"{len(self.rows)} comparisons, {self.page}", titles, rows)


def _pair(row: Row) -> tuple[str, str]:
    if row.measured is None or row.model is None:
        return "", ""
    return _with_unit(f"{row.measured:.5g}", row), _with_unit(f"{row.model:.5g}", row)


def _agreement(row: Row) -> str:
    if row.nrmse is not None:
        return f"nRMSE {100 * row.nrmse:.2f} %"
    u = "" if row.u_difference is None else f" ± {row.u_difference:.1e}"
    return "" if row.difference is None else _with_unit(f"{row.difference:+.2e}{u}", row)


def _with_unit(text: str, row: Row) -> str:
    """Write a number with its unit; a ratio has none."""
    return text if row.unit == "1" else f"{text} {row.unit}"


def labelled(row: Row, experiment: Experiment, session: Session) -> Row:
    """Say of a row which experiment it is of and, where it does not, of what and how."""
    material, condition = row.material or _material(experiment, session), row.condition or _condition(experiment)
    return replace(row, experiment=experiment.name, kind=experiment.kind, material=material, condition=condition)


def compared(results: Results, name: str) -> list[Row] | None:
    """Return what an experiment compares, by the results that are there; None where they are not."""
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
    """Return what a body is made of; of a film that names none, that of the drops it is laid against."""
    kind = KINDS[experiment.kind]
    body = getattr(experiment.settings, kind.body, None)
    texts = (getattr(body, n, None) for n in ("material", "material_from", "material_file"))
    own = next((text.removeprefix(REFERENCE) for text in texts if isinstance(text, str)), "")
    if own:
        return own
    fields = {
        name.removeprefix(OTHER).split("/")[0] for s in kind.stages for name in s.inputs if name.startswith(OTHER)
    }
    named = (field_value(experiment.settings, field) for field in sorted(fields))
    others = (session.experiments.get(text.removeprefix(REFERENCE)) for text in named if isinstance(text, str))
    found = (_material(other, session) for other in others if other is not None and other.name != experiment.name)
    return next(filter(None, found), "")


def _condition(experiment: Experiment) -> str:
    parts = []
    height = getattr(experiment.settings, "height", None)
    if height is not None:
        parts.append(f"{height.value * 1e3:g} mm")
    body = getattr(experiment.settings, KINDS[experiment.kind].body, None)
    temperature = getattr(body, "temperature", None)
    if temperature is not None:
        parts.append(f"{temperature.value:g} °C")
    return ", ".join(parts)
