"""Verdicts on a session: which experiments can be believed, and where the model agrees.

The stage ``judgement`` of a kind holds its verdict. Where it was not stored, because something
before it failed or was not asked for, it is made again from what is there.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import islice
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any

from labpipe import files
from labpipe.errors import LabpipeError, StorageError
from labpipe.notebook import Shown, ShownAsTable
from labpipe.workflow.code import behind
from labpipe.workflow.context import Context, Failed, Warned
from labpipe.workflow.plan import READY, Plan, Row
from labpipe.workflow.results import Results
from labpipe.workflow.session import FILE_NAME, Experiment, Session
from labpipe.workflow.store import Store, key_of
from labpipe.workflow.tasks import arguments
from pipelines.experiments import JUDGEMENT, KINDS, function
from pipelines.session._gaps import library_names
from pipelines.session._opening import STAGES, reopen_session
from pipelines.session._results import opened
from pipelines.session._session_checks import named_at, named_files, of_record, session_findings
from pipelines.session._stated_alike import TWO_VALUES
from pipelines.session._unused import unused_files
from pipelines.session._waiting import WAITING, that_wait

if TYPE_CHECKING:
    import xarray as xr

    from labpipe.judging import Finding, Judgement
    from labpipe.workflow.run_result import RunResult

VERDICTS = f"{__name__}:stored_verdicts"
"""Whose code the kept ones are of."""
_LONGEST_LINE = 100  # characters of a line that is shown
_KEPT = "verdicts.json"
"""Among the results: the verdicts as they were last told."""
FAILED_VERDICTS = "verdicts-of-failures.json"
"""Beside it: those on experiments of which a step failed, whose judgements are no results to be read again."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict on one experiment.

    Attributes
    ----------
    experiment, kind : str
    state : str
        ``"done"``, ``"failed"``, ``"waiting"`` (for lines of its settings, which are its findings) or
        ``"not processed"``.
    believable : "yes", "doubtful", "impossible" or "unknown"
    model : "agrees", "differs", "undecided" or "none"
    findings : tuple of Finding
        With file and line.
    checks : int
        How many were made of this experiment, as its page says; those of the session are not counted.
    causes : tuple of str
        What would explain the findings, the likeliest first.
    suspects : tuple of str
        What would explain a model that differs, or why it cannot be held against the record.
    n_of_session : int
        How many of the findings, the last ones, the session as a whole tells.
    """

    experiment: str
    kind: str
    state: str
    believable: str
    model: str
    findings: tuple[Finding, ...] = ()
    checks: int = 0
    causes: tuple[str, ...] = ()
    suspects: tuple[str, ...] = ()
    n_of_session: int = 0

    @property
    def of_session(self) -> tuple[Finding, ...]:
        """The findings that the session as a whole tells."""
        return self.findings[len(self.findings) - self.n_of_session :]

    @property
    def cause(self) -> str:
        """What most likely is wrong with the record; empty where it is believable, or nothing is known."""
        grave = [finding for finding in self.findings if finding.level == self.believable]
        return grave[0].cause or next(iter(self.causes), "") if grave else ""

    @property
    def is_by_session(self) -> bool:
        """Whether only what the session as a whole tells speaks against the record."""
        own = self.findings[: len(self.findings) - self.n_of_session]
        return self.believable != "yes" and not any(f.level == self.believable for f in own)

    @classmethod
    def of(cls, kept: Mapping[str, Any]) -> Verdict:
        """Make a verdict again of its fields as JSON."""
        from labpipe.judging import Finding

        findings = tuple(Finding(**finding) for finding in kept["findings"])
        texts = {name: tuple(kept[name]) for name in ("causes", "suspects")}
        return cls(**{**kept, "findings": findings, **texts})

    def document(self) -> dict[str, Any]:
        """Return the verdict for JSON."""
        texts = {"causes": list(self.causes), "suspects": list(self.suspects)}
        made = asdict(self) | {"findings": _documents(self.findings)} | texts
        # what the session as a whole tells is a finding like the others
        return {name: value for name, value in made.items() if name != "n_of_session"}

    def __getitem__(self, name: str) -> Any:
        """Return a field as it stands in the JSON of ``process``, so that one code reads both."""
        return self.document()[name]


@dataclass(frozen=True, slots=True, repr=False)
class Verdicts(ShownAsTable):
    """Verdicts on the experiments of a session, in its order, those that wait last.

    Attributes
    ----------
    folder : Path
    experiments : tuple of Verdict
    notes : tuple of Finding
        What concerns no experiment: files that none uses.
    """

    folder: Path
    experiments: tuple[Verdict, ...]
    notes: tuple[Finding, ...] = ()

    @property
    def is_impossible(self) -> bool:
        """Whether any record contradicts itself, physics, or what the session states."""
        return any(v.believable == "impossible" for v in self.experiments)

    def document(self) -> list[dict[str, Any]]:
        """Return all verdicts for JSON."""
        return [verdict.document() for verdict in self.experiments]

    def __getitem__(self, name: str) -> list[dict[str, Any]]:
        """Return ``verdicts["experiments"]`` or ``["findings"]`` as it stands in the JSON of ``process``."""
        return {"experiments": self.document, "findings": self.notes_document}[name]()

    def _shown(self) -> Shown:
        rows = [
            (v.experiment, v.believable, v.model, "; ".join(f.message for f in v.findings)) for v in self.experiments
        ]
        return Shown(f"{len(rows)} verdicts", ("experiment", "believable", "model", "findings"), rows)

    def notes_document(self) -> list[dict[str, Any]]:
        """Return what concerns no experiment, for JSON."""
        return _documents(self.notes)


def _documents(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    names = ("check", "level", "message", "cause", "file", "line", "value")
    return [{name: getattr(finding, name) for name in names} for finding in findings]


def verdicts_of(run: RunResult) -> Verdicts:
    """Return the verdicts on the experiments that a run has processed."""
    session = run.session
    failures: dict[str, list[Failed]] = {outcome.experiment: [] for outcome in run.outcomes}
    for outcome in run.failures:
        why = outcome.message, outcome.is_of_run, outcome.reason
        failures[outcome.experiment].append(Failed(outcome.stage, outcome.recording, *why))
    results = opened(session.root) if run.plan is None else Results(run.plan)
    known = stored_verdicts(results)
    made = [
        _one(session, results, session.experiments[name], failed)
        for name, failed in failures.items()
        if name not in known
    ]
    new = {v.experiment: v for v in _with_session(session, made)} if made else {}
    _keep(results.plan, {n: v for n, v in new.items() if failures[n] and not any(f.is_of_run for f in failures[n])})
    known |= new
    found = (replace(known[name], state="failed" if failed else "done") for name, failed in failures.items())
    return Verdicts(session.root, (*found, *waiting_verdicts(session).values()), tuple(unused_files(session)))


def waiting_verdicts(session: Session) -> dict[str, Verdict]:
    """Return a verdict on each experiment that waits: nothing is known of it but the lines to correct."""
    return {
        name: Verdict(name, kind, WAITING, "unknown", "none", findings) for name, kind, findings in that_wait(session)
    }


def stored_verdicts(results: Results) -> dict[str, Verdict]:
    """Return the verdicts of a session that are there and up to date; no experiment is judged anew.

    They are kept beside the results, under a digest of all that they come from, so that to say
    them again takes neither NumPy nor the files of the results.
    """
    return _of_failures(results.plan) | _of_judgements(results)


def _of_judgements(results: Results) -> dict[str, Verdict]:
    session = results.plan.session
    store = Store(session.folder)
    rows = [row for row in results.plan.rows if row.stage == JUDGEMENT and row.state in READY]
    if not rows:
        return {}
    path, mark = store.root / _KEPT, _mark(results.plan, rows, store)
    try:
        kept = files.unseal(path.read_bytes())
        if kept["mark"] == mark:
            return {one["experiment"]: Verdict.of(one) for one in kept["verdicts"]}
    except (OSError, KeyError, TypeError):  # absent, damaged, or another record of ours
        pass
    judged = [(row.experiment, result) for row in rows if (result := results.up_to_date(row)) is not None]
    found = [_of_result(session, session.experiments[name], "done", result) for name, result in judged]
    verdicts = _with_session(session, found)
    if len(found) == len(rows) and session.experiments.keys() == {row.experiment for row in results.plan.rows}:
        with contextlib.suppress(StorageError):  # it only saves time
            files.write_bytes(path, files.seal({"mark": mark, "verdicts": [asdict(v) for v in verdicts]}))
    return {v.experiment: v for v in verdicts}


def _of_failures(plan: Plan) -> dict[str, Verdict]:
    """Return the verdicts on experiments that failed and would fail again, nothing of theirs having changed."""
    store = Store(plan.session.folder)
    try:
        kept = files.unseal((store.root / FAILED_VERDICTS).read_bytes()) or {}
    except OSError:
        return {}
    there = [name for name in kept if name in plan.session.experiments]
    return {
        name: Verdict.of(kept[name]["verdict"])
        for name in there
        if kept[name]["mark"] == _mark(plan, _rows_behind(plan, name), store)
    }


def _keep(plan: Plan, verdicts: Mapping[str, Verdict]) -> None:
    if not verdicts:
        return
    store = Store(plan.session.folder)
    known = {
        name: {"mark": _mark(plan, _rows_behind(plan, name), store), "verdict": asdict(one)}
        for name, one in {**_of_failures(plan), **verdicts}.items()
    }
    with contextlib.suppress(StorageError):  # the next run says it again
        files.write_bytes(store.root / FAILED_VERDICTS, files.seal(known))


def _rows_behind(plan: Plan, name: str) -> list[Row]:
    """Return the rows of an experiment and of all that it refers to."""
    names, new = set[str](), {name}
    while new:
        names |= new
        new = {other for one in new for other in plan.session.experiments[one].refers_to} - names
        new &= plan.session.experiments.keys()
    return [row for row in plan.rows if row.experiment in names]


def _mark(plan: Plan, rows: Iterable[Row], store: Store) -> str:
    """Digest of all that verdicts come from: results, settings with their lines, files named, and code."""
    session = plan.session
    named = [
        [n.experiment, n.setting, n.path.resolve().as_posix(), store.index.digest(n.path) if n.path.exists() else None]
        for n in named_files(session)
    ]
    judgements = [[row.experiment, plan.keys[row.task].value, plan.keys[row.task].problem] for row in rows]
    code = behind(VERDICTS, "pipelines.experiments")
    settings = files.digest(session.root / FILE_NAME)
    return key_of({"verdicts": [code, settings, library_names(), named, judgements]})


def told_verdicts(folder: str | Path) -> dict[str, Verdict]:
    """Return the verdicts on all experiments of a session that are up to date, as every outlet tells them."""
    return stored_verdicts(opened(folder))


def verdict_on(folder: str | Path, experiment: str, *, is_running: bool = False) -> Verdict:
    """Return the verdict on one experiment by what is stored; nothing is processed.

    While the others are being processed, what is found by comparing with them comes later.
    """
    known = {} if is_running else told_verdicts(folder)
    if experiment in known:
        return known[experiment]
    session = reopen_session(folder)
    one = _one(session, opened(session.root, [experiment]), session.experiments[experiment], ())
    return _with_session(session, [one])[0]


def _one(session: Session, results: Results, experiment: Experiment, failures: Iterable[Failed]) -> Verdict:
    failed = tuple(failures)
    state = "failed" if failed else "done"
    kind = experiment.kind
    stage = next((s for s in KINDS[kind].stages if s.name == JUDGEMENT), None)
    if stage is None:
        return Verdict(experiment.name, kind, state, "unknown", "none")
    result = results.first(experiment.name, JUDGEMENT)
    if result is None:
        given = [_tolerant(results, a) for a in arguments(session, STAGES, experiment, stage.inputs)]
        stated = (session.title, session.operator, session.notes, session.synthetic)
        warned = _warned(results, experiment)
        context = Context(experiment.name, kind, *stated, warnings=warned, failures=failed)
        try:
            result = function(stage.function)(*given, settings=experiment.settings, context=context)
        except Exception as error:
            # checks of a kind are foreign code to a session: they end this verdict alone
            return _not_judged(experiment, error)
    return _of_result(session, experiment, state, result)


def _warned(results: Results, experiment: Experiment) -> tuple[Warned, ...]:
    """Return what the steps of an experiment that gave a result warned of."""
    store, keys = Store(results.plan.session.folder), results.plan.keys
    tasks = [row.task for row in results.plan.rows if row.experiment == experiment.name]
    records = [(task, store.record(value)) for task in tasks if (value := keys[task].value) is not None]
    return tuple(
        Warned(task.stage, task.recording, w.category, w.text, w.count)
        for task, record in records
        if record is not None
        for w in record.warnings
    )


def _not_judged(experiment: Experiment, error: Exception) -> Verdict:
    """Say that the checks themselves broke, which tells nothing about the record."""
    from labpipe.judging import Finding

    text = f"the checks broke: {type(error).__name__}: {error}"
    cause = "this tells nothing about the record: report it, with the session"
    finding = Finding(f"step {JUDGEMENT}", "note", text, cause)
    return Verdict(experiment.name, experiment.kind, "failed", "unknown", "undecided", (finding,), causes=(cause,))


def _of_result(session: Session, experiment: Experiment, state: str, result: xr.Dataset) -> Verdict:
    from labpipe.judging import from_json
    from pipelines.experiments.shared.judgements import suspected

    judged: Judgement = from_json(result.attrs["judgement"])
    findings = tuple(_placed(session, experiment, f) for f in judged.findings)
    return Verdict(
        experiment.name,
        experiment.kind,
        state,
        judged.believable,
        str(result.attrs["model"]),
        findings,
        judged.n_made,
        judged.causes,
        tuple(suspected(result)),
    )


def _tolerant(results: Results, argument: Any) -> Any:
    """Return an input as a stage gets it, with None for what is not there."""
    found: list[Any] = [results.folder / name for name in argument.files]
    for task in argument.tasks:
        try:
            found.append(results.result(*task))
        except LabpipeError:
            found.append(None)
    return argument.arranged(found)


def _placed(session: Session, experiment: Experiment, finding: Finding) -> Finding:
    """Find the line of a setting as the files are now, and its text; of a recording, where session.toml names it."""
    finding = of_record(session, finding)
    line = finding.line
    if line is None and not finding.file:
        name, lines = finding.setting, experiment.lines
        while name and name not in lines:
            name = name.rpartition(".")[0]
        finding, line = replace(finding, file=FILE_NAME), lines.get(name, lines.get(""))
    elif line is None and finding.setting:
        line = _line_in(session.root / finding.file, finding.setting)
    if line is None:
        named = named_at(session).get(finding.file)
        return finding if named is None else replace(finding, value=f"named in {FILE_NAME}:{named}")
    return replace(finding, line=line, value=_text_of(session.root / finding.file, line))


def _text_of(path: Path, line: int) -> str:
    """Return a line of a text file, shortened; empty where there is none."""
    try:
        with path.open(encoding="utf-8", errors="replace") as lines:
            text = next(islice(lines, line - 1, None), "")
    except OSError:
        return ""
    return shorten(text.strip(), _LONGEST_LINE, placeholder=" …")


def _line_in(path: Path, setting: str) -> int | None:
    """Return the line of a TOML file on which a setting stands."""
    from labpipe.workflow.document import parse

    try:
        return parse(path).line(tuple(setting.split(".")))
    except (LabpipeError, KeyError):
        return None


def _with_session(session: Session, verdicts: Iterable[Verdict]) -> tuple[Verdict, ...]:
    """Add what the session as a whole tells of its experiments."""
    found = tuple(verdicts)
    more = session_findings(session)
    placed = {n: [_placed(session, session.experiments[n], f) for f in own] for n, own in more.items()}
    return tuple(_added(v, placed.get(v.experiment, ())) for v in found)


def _added(verdict: Verdict, more: Iterable[Finding]) -> Verdict:
    told = {(f.file, f.line, f.level) for f in verdict.findings if f.line is not None}
    # another experiment's value says by how much the one of this line is wrong, which no record says so well
    extra = tuple(f for f in more if f.check == TWO_VALUES or (f.file, f.line, f.level) not in told)
    worse: Mapping[str, str] = {"yes": "doubtful", "unknown": "doubtful"}
    believable = verdict.believable
    if any(f.level == "doubtful" for f in extra):
        believable = worse.get(believable, believable)
    return replace(verdict, believable=believable, findings=(*verdict.findings, *extra), n_of_session=len(extra))
