"""The page of a whole session: every experiment with its state, key numbers and a small picture."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe import files
from labpipe.errors import LabpipeError
from labpipe.workflow.plan import CACHED, Plan, Row, make_plan, page_name
from labpipe.workflow.session import Session
from labpipe.workflow.store import Store
from labpipe.workflow.tasks import Stages, spell_out

if TYPE_CHECKING:
    import xarray as xr

    from labpipe.report import Column, IndexRow, LineChart, ScatterChart

PAGE = "index.html"
"""Below ``SESSION/labpipe``; an experiment cannot have a page of that name there."""
COMPARISON_PAGE = "compare.html"
"""Beside it, once ``labpipe compare`` has written it."""
_FORMAT = 4
"""Raised when the page's content changes for equal results."""


@dataclass(frozen=True, slots=True)
class KeyNumber:
    """One column: a title, an SI unit, and where each kind of experiment has the number."""

    title: str
    unit: str
    sources: dict[str, tuple[str, str]]


KEY_NUMBERS = (
    KeyNumber(
        "first restitution", "1",
        {"ball_drop": ("repeats", "restitution"), "dic_validation": ("bounces", "restitution")},
    ),
    KeyNumber("film minus laser", "m", {"dic_validation": ("comparison", "bias")}),
    KeyNumber("largest contact radius", "m", {"contact_area": ("impacts", "peak_radius")}),
    KeyNumber(
        "contact radius under the first load", "m",
        {"static_loading": ("approach", "level_contact_radius")},
    ),
    KeyNumber("storage stiffness", "N/m", {"harmonic": ("oscillations", "storage_stiffness")}),
    KeyNumber("plateau force", "N", {"relaxation": ("tests", "plateau_force")}),
    KeyNumber("plate frequency", "Hz", {"plate_vibration": ("plate", "frequency")}),
    KeyNumber("relaxed modulus", "Pa", {"dma": ("master_curve", "E_relaxed")}),
)  # fmt: skip
"""The first finite value of a variable of a result."""

PICTURES = {
    "ball_drop": ("repeats", "time", "displacement_mean", "linear"),
    "harmonic": ("loops", "position", "force", "linear"),
    "dma": ("master_curve", "reduced_frequency", "master_storage", "log"),
    "dic_validation": ("motion", "time", "displacement", "linear"),
    "contact_area": ("radius", "time", "radius", "linear"),
    "relaxation": ("loads", "time", "force", "linear"),
    "static_loading": ("displacement", "time", "displacement", "linear"),
    "plate_vibration": ("displacement", "time", "displacement", "linear"),
}
"""Stage, abscissa, ordinate and scale of the small picture of each kind; others have none.

Of a stage that runs per recording, the first recording is shown.
"""

_REPORT, _DONE = "report", "done"
_TITLES = {"dma": "DMA", "dic_validation": "Camera against laser"}
_FEW_KINDS = 3  # that share one table
_CAPTION = (
    "Select a heading to sort. The error is the root mean square of measurement minus model (of "
    "film minus laser) over the range of the measurement, that of the worst repeat, impact or "
    "frequency."
)
_COMPARISON, _ERROR = "comparison", "nrmse"
_ERRORS = {"static_loading": "nrmse_approach_model", "relaxation": "nrmse_all"}
"""Kinds whose comparison has several errors: the one that speaks for the whole."""


def write_overview(session: Session, stages: Stages) -> Path:
    """Write the page of a session, unless it is up to date.

    Parameters
    ----------
    session : Session
        With all its experiments.
    stages : mapping
        The stages of every kind.

    Returns
    -------
    Path
        ``SESSION/labpipe/index.html``.
    """
    store = Store(session.folder)
    tasks = spell_out(session, stages)
    plan = make_plan(session, tasks, frozenset(tasks), store)
    path = session.folder / PAGE
    mark = f"<!-- {_state_digest(plan)} -->\n"
    if not (path.is_file() and path.read_text("utf-8").endswith(mark)):
        files.write_text(path, _page(plan, store) + mark)
    return path


def _state_digest(plan: Plan) -> str:
    """Digest of all that the page depends on."""
    session = plan.session
    rows = [
        [row.experiment, row.stage, row.recording, row.state, plan.keys[row.task].value,
         (session.folder / page_name(row.experiment)).is_file()]
        for row in plan.rows
    ]  # fmt: skip
    has_comparison = (session.folder / COMPARISON_PAGE).is_file()
    head = [_FORMAT, session.title, session.operator, session.notes, session.synthetic,
            has_comparison]  # fmt: skip
    return hashlib.sha256(files.canonical([head, rows]).encode("utf-8", "replace")).hexdigest()


def _page(plan: Plan, store: Store) -> str:
    from labpipe.report import Document, IndexTable, Section

    session = plan.session
    caption = _CAPTION
    sections, states = [], []
    for title, names in _groups(session):
        columns, cells = _columns(plan, store, names)
        rows = tuple(_row(plan, store, name, cells[name]) for name in names)
        sections.append(Section(title, (IndexTable(tuple(columns), rows, caption),)))
        states += [row.state for row in rows]
        caption = ""  # once is enough
    if below := _below(session):
        sections.append(Section("Session", below))
    about = [f"{states.count(_DONE)} of {len(states)} experiments done"]
    if session.operator:
        about.insert(0, f"recorded by {session.operator}")
    return Document(
        session.title, " · ".join(about), "synthetic data" if session.synthetic else "",
        tuple(sections),
    ).render()  # fmt: skip


def _groups(session: Session) -> list[tuple[str, list[str]]]:
    """Put all experiments into one table, or those of each kind where kinds are many.

    Every kind has key numbers of its own; a table of all would be wide and mostly empty.
    """
    by_kind: dict[str, list[str]] = {}
    for name, experiment in session.experiments.items():
        by_kind.setdefault(experiment.kind, []).append(name)
    if len(by_kind) <= _FEW_KINDS:
        return [("Experiments", list(session.experiments))]
    return [
        (_TITLES.get(kind, kind.replace("_", " ").capitalize()), names)
        for kind, names in by_kind.items()
    ]


def _below(session: Session) -> tuple[Any, ...]:
    """Lead to the comparison of all experiments, and show the notes."""
    from labpipe.report import Link, Paragraph

    blocks: list[Any] = []
    if (session.folder / COMPARISON_PAGE).is_file():
        remark = "all experiments in one table, as of the last labpipe compare"
        blocks.append(Link("Measurement against model", COMPARISON_PAGE, remark))
    if session.notes:
        blocks.append(Paragraph(session.notes))
    return tuple(blocks)


def _columns(
    plan: Plan, store: Store, names: Sequence[str]
) -> "tuple[list[Column], dict[str, list[Any]]]":
    """Columns that at least one of the experiments has a number for, and the cells of each."""
    from labpipe.report import Column

    experiments = [plan.session.experiments[name] for name in names]
    columns = [
        Column("error", "1", digits=2),
        *(Column(number.title, number.unit, digits=4) for number in KEY_NUMBERS),
        Column("warnings"),
    ]
    cells: dict[str, list[Any]] = {}
    for experiment in experiments:
        sources = [number.sources.get(experiment.kind) for number in KEY_NUMBERS]
        error = _ERRORS.get(experiment.kind, _ERROR)
        cells[experiment.name] = [
            _number(plan, store, experiment.name, (_COMPARISON, error), is_worst=True),
            *(_number(plan, store, experiment.name, source) for source in sources),
            _warnings(plan, store, experiment.name),
        ]
    is_used = [any(row[i] is not None for row in cells.values()) for i in range(len(columns))]
    kept = [i for i, used in enumerate(is_used) if used]
    return [columns[i] for i in kept], {name: [row[i] for i in kept] for name, row in cells.items()}


def _number(
    plan: Plan, store: Store, name: str, source: tuple[str, str] | None, *, is_worst: bool = False
) -> float | None:
    import numpy as np

    dataset = _dataset(plan, store, name, source[0]) if source else None
    if dataset is None or source is None or source[1] not in dataset:
        return None
    values = np.atleast_1d(np.asarray(dataset[source[1]].values, float))
    values = values[np.isfinite(values)]
    if not values.size:
        return None
    return float(values.max() if is_worst else values.flat[0])


def _dataset(plan: Plan, store: Store, name: str, stage: str) -> "xr.Dataset | None":
    rows = (row for row in plan.rows if (row.experiment, row.stage) == (name, stage))
    row = next(rows, None)
    return None if row is None else up_to_date(plan, store, row)


def up_to_date(plan: Plan, store: Store, row: Row) -> "xr.Dataset | None":
    """Return a result that is up to date; None when there is none, or it is damaged."""
    key = plan.keys[row.task].value
    if row.state != CACHED or key is None or plan.tasks[row.task].stage.output != "dataset":
        return None
    try:
        found = store.read(key)
    except LabpipeError:
        return None  # the next run makes it again; the page says that it is not there
    return None if isinstance(found, str) else found


def _warnings(plan: Plan, store: Store, name: str) -> int:
    keys = [plan.keys[row.task].value for row in plan.rows if row.experiment == name]
    records = [store.record(key) for key in keys if key is not None]
    return sum(len(record.warnings) for record in records if record is not None)


def _row(plan: Plan, store: Store, name: str, cells: Sequence[Any]) -> "IndexRow":
    from labpipe.report import IndexRow

    rows = [row for row in plan.rows if row.experiment == name]
    has_page = (plan.session.folder / page_name(name)).is_file()
    waiting = [row for row in rows if row.state != CACHED]
    kind = plan.session.experiments[name].kind.replace("_", " ")
    unreadable = next((plan.keys[r.task].problem for r in rows if plan.keys[r.task].problem), "")
    state, level = _DONE, "ok"
    if unreadable:
        state, level = "waiting for files", "warning"
    elif has_page and {row.stage for row in waiting} == {_REPORT}:
        state, level = "page out of date", "warning"
    elif waiting and has_page:
        state, level = f"{len(waiting)} of {len(rows)} steps to do or failed", "error"
    elif waiting:
        state, level = "not processed", "info"
    return IndexRow(
        name, state, level,  # type: ignore[arg-type]
        href=page_name(name) if has_page else "",
        metrics=tuple(cells),
        thumbnail=_picture(plan, store, name),
        remark=f"{kind}; {unreadable}" if unreadable else kind,
    )  # fmt: skip


def _picture(plan: Plan, store: Store, name: str) -> bytes | None:
    from labpipe.report import thumbnail

    source = PICTURES.get(plan.session.experiments[name].kind)
    dataset = _dataset(plan, store, name, source[0]) if source else None
    if source is None or dataset is None or not {source[1], source[2]} <= set(dataset.variables):
        return None
    chart = _chart(dataset, *source[1:])
    return None if chart is None else thumbnail(chart)


def _chart(
    dataset: "xr.Dataset", x_name: str, y_name: str, scale: Any
) -> "LineChart | ScatterChart | None":
    import numpy as np

    from labpipe.report import LineChart, ScatterChart, Series

    x, y = np.asarray(dataset[x_name].values, float), np.asarray(dataset[y_name].values, float)
    if x.ndim > 1:  # one loop per frequency
        loops = [(a[np.isfinite(a + b)], b[np.isfinite(a + b)]) for a, b in zip(x, y, strict=True)]
        series = [Series(str(i), a, b) for i, (a, b) in enumerate(loops) if a.size]
        return ScatterChart("", x_name, y_name, series) if series else None
    if np.count_nonzero(np.isfinite(x) & np.isfinite(y)) < 2:
        return None
    known = np.flatnonzero(np.isfinite(x))
    order = known[np.argsort(x[known], kind="stable")]
    # A value that is missing is a gap in the curve, not a line across it.
    series = [Series(y_name, x[order], np.where(np.isinf(y), np.nan, y)[order])]
    return LineChart("", x_name, y_name, series, x_scale=scale, y_scale=scale)
