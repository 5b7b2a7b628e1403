"""Verdicts on a session: the experiments that can be believed, and those in which the model agrees.

The stage ``judgement`` of a kind holds its verdict. Where it was not stored, because something
before it failed or was not asked for, it is made again from the results that there are.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from textwrap import shorten
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import msgspec

from labpipe import files
from labpipe.errors import LabpipeError, StorageError
from labpipe.judging import Finding
from labpipe.notebook import Shown, ShownAsTable
from labpipe.text import survey
from labpipe.workflow.code import behind
from labpipe.workflow.document import parse
from labpipe.workflow.fields import REFERENCE, every_setting
from labpipe.workflow.graph import Stage, TaskId
from labpipe.workflow.plan import READY
from labpipe.workflow.provenance import context_of
from labpipe.workflow.results import Results
from labpipe.workflow.session import FILE_NAME, Experiment, Session
from labpipe.workflow.store import Store, key_of
from pipelines.experiments import JUDGEMENT, KINDS, function
from pipelines.session._gaps import library_names
from pipelines.session._results import opened
from pipelines.session._session_checks import (
    SEVERAL,
    TWO_VALUES,
    named_files,
    of_record,
    session_findings,
    unused_files,
    unusual_values,
)

if TYPE_CHECKING:
    from labpipe.judging import Judgement
    from labpipe.workflow.context import Outcome
    from labpipe.workflow.results import RunResult

WAITING = "waiting"
"""State of an experiment whose settings are incomplete."""
VERDICTS = "verdicts.json"
"""Among the results: verdicts by experiment, each with the digest of all that it comes from."""
_CURVE = "master_curve"
"""Stage whose result is a material that the session has measured."""
_DOCUMENTED = ("check", "level", "message", "cause", "file", "line", "value")
_LONGEST_LINE = 100  # characters of a line that is shown


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict on one experiment.

    ``state`` is ``"done"``, ``"failed"``, ``"waiting"`` (for lines of its settings, which are its findings) or ``"not
    processed"``; ``believable`` "yes", "doubtful", "impossible" or "unknown"; ``model`` "agrees", "differs",
    "undecided" or "none". ``checks`` counts those of this experiment, as on its page. ``causes`` explain the findings,
    the likeliest first, ``suspects`` a model that differs, or say why it cannot be held against the record.
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

    @property
    def cause(self) -> str:
        """The most likely mistake in the record; empty where it is believable, or nothing is known."""
        grave = [finding for finding in self.findings if finding.level == self.believable]
        # another experiment's value says what is wrong, which no failed step says so well
        grave = [f for f in self.findings if f.check == TWO_VALUES and f.level != "note"] + grave
        return grave[0].cause or next(iter(self.causes), "") if grave else ""

    def document(self) -> dict[str, Any]:
        """Return the verdict for JSON."""
        plain: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(self))
        return plain | {"findings": _documents(self.findings)}

    def __getitem__(self, name: str) -> Any:
        """Return a field as in the JSON of ``process``, so that one code reads both."""
        return self.document()[name]


@dataclass(frozen=True, slots=True, repr=False)
class Verdicts(ShownAsTable):
    """Verdicts on the experiments of a session, in its order, those that wait last.

    ``notes`` are findings that concern no experiment: files that none uses.
    """

    folder: Path
    experiments: tuple[Verdict, ...]
    notes: tuple[Finding, ...] = ()

    @property
    def is_impossible(self) -> bool:
        """Whether any record contradicts itself, physics, or the session's statements."""
        return any(v.believable == "impossible" for v in self.experiments)

    def __getitem__(self, name: str) -> list[dict[str, Any]]:
        """Return ``verdicts["experiments"]`` or ``["findings"]`` as in the JSON of ``process``."""
        return {"experiments": [v.document() for v in self.experiments], "findings": _documents(self.notes)}[name]

    def _shown(self) -> Shown:
        rows = [
            (v.experiment, v.believable, v.model, "; ".join(f.message for f in v.findings)) for v in self.experiments
        ]
        return Shown(f"{len(rows)} verdicts", ("experiment", "believable", "model", "findings"), rows)


def _documents(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    return [{name: getattr(finding, name) for name in _DOCUMENTED} for finding in findings]


def verdicts_of(run: RunResult) -> Verdicts:
    """Return the verdicts on the experiments that a run has processed."""
    session = run.session
    failures: dict[str, list[Outcome]] = {outcome.experiment: [] for outcome in run.outcomes}
    for outcome in run.failures:
        failures[outcome.experiment].append(outcome)
    known = stored_verdicts(opened(session.root) if run.plan is None else Results(run.plan), failures)
    found = (replace(known[name], state="failed" if failed else "done") for name, failed in failures.items())
    return Verdicts(session.root, (*found, *waiting_verdicts(session).values()), tuple(unused_files(session)))


def waiting_verdicts(session: Session) -> dict[str, Verdict]:
    """Return a verdict on each experiment that waits: its findings are the lines to fill in or correct."""
    tables = parse(session.root / FILE_NAME).tree.get("experiments", {}) if session.waiting else {}
    found = {}
    for name, problems in session.waiting.items():
        findings = []
        for problem in problems:
            place = re.fullmatch(r"([^:]+):(\d+): (.*)", problem, re.DOTALL)
            file, line, text = (place[1], int(place[2]), place[3]) if place else (FILE_NAME, None, problem)
            verb = "fill in" if "to be filled in" in text else "correct"
            remedy = f"{verb} {f'line {line} of ' if line else ''}{file}, then process again"
            if text.endswith("which waits"):
                remedy = "it runs as soon as that one does: see there"
            findings.append(Finding("settings", "note", text, remedy, file, line))
        kind = str(tables.get(name, {}).get("kind", ""))
        found[name] = Verdict(name, kind, WAITING, "unknown", "none", tuple(findings))
    return found


def stored_verdicts(
    results: Results, failures: Mapping[str, Sequence[Outcome]] = MappingProxyType({})
) -> dict[str, Verdict]:
    """Return the verdicts of a session that are there and up to date, and those on experiments with ``failures``.

    They are kept with the results, each under a digest of all that it comes from, so that reading
    them again takes neither NumPy nor the files of the results. Of an experiment of which a step
    failed, and would fail again, only the kept verdict is known. No other is judged anew.
    """
    session, path = results.plan.session, Store(results.plan.session.folder).root / VERDICTS
    judged = {row.experiment: row for row in results.plan.rows if row.stage == JUDGEMENT and row.state in READY}
    kept: dict[str, tuple[str, Verdict]] = {}
    with contextlib.suppress(OSError, msgspec.ValidationError):  # absent or damaged
        kept = msgspec.convert(files.unseal(path.read_bytes()) or {}, dict[str, tuple[str, Verdict]])
    if not judged and not kept and not failures:
        return {}
    marks, made, lasting = _marks(results), list[Verdict](), set[str]()
    kept = {name: one for name, one in kept.items() if marks.get(name) == one[0]}
    for name in (name for name in session.experiments if name not in kept):
        failed = failures.get(name, ())
        if name in judged and (result := results.up_to_date(judged[name].task)) is not None:
            made.append(_of_result(session, session.experiments[name], "done", result))
            lasting.add(name)
        elif name in failures:
            made.append(_one(results, session.experiments[name], failed))
            lasting |= {name} if failed and not any(f.is_of_run for f in failed) else set()
    new = {v.experiment: v for v in _with_session(results, made)}
    if lasting:
        kept |= {name: (marks[name], new[name]) for name in lasting}
        with contextlib.suppress(StorageError):  # it only saves time
            files.write_bytes(path, files.seal(msgspec.to_builtins(dict(sorted(kept.items())))))
    return {name: new[name] if name in new else kept[name][1] for name in session.experiments if name in new | kept}


def _marks(results: Results) -> dict[str, str]:
    """Digest, by experiment, all that a verdict comes from: results, settings and their lines, files, and code."""
    session, plan = results.plan.session, results.plan
    index = Store(session.folder).index
    named = [
        [n.experiment, n.setting, n.path.resolve().as_posix(), index.digest(n.path) if n.path.exists() else None]
        for n in named_files(session)
    ]
    code = behind(f"{__name__}:{stored_verdicts.__name__}", "pipelines.experiments")
    others = [plan.keys[r.task].value for r in plan.rows if r.stage in (_CURVE, JUDGEMENT) and r.state in READY]
    common = key_of({"verdicts": [code, files.digest(session.root / FILE_NAME), library_names(), named, others]})
    keys: dict[str, list[Any]] = {}
    for row in plan.rows:
        key, is_judged = plan.keys[row.task], row.stage == JUDGEMENT and row.state in READY
        keys.setdefault(row.experiment, []).append([key.value, key.problem, is_judged])
    return {name: key_of({"verdict": [common, own]}) for name, own in keys.items()}


def verdict_on(folder: str | Path, experiment: str, *, is_running: bool = False) -> Verdict:
    """Return the verdict on one experiment by its stored results; nothing is processed.

    While the others are being processed, findings that compare it with them come later.
    """
    if not is_running:
        return stored_verdicts(opened(folder), {experiment: ()})[experiment]
    results = opened(folder, [experiment])
    return _with_session(results, [_one(results, results.experiments[experiment], ())])[0]


def _one(results: Results, experiment: Experiment, failed: Sequence[Outcome]) -> Verdict:
    """Return the verdict on an experiment by the results that there are."""
    session, name, kind, state = results.plan.session, experiment.name, experiment.kind, "failed" if failed else "done"
    stage = next((s for s in KINDS[kind].stages if s.name == JUDGEMENT), None)
    if stage is None:
        return Verdict(name, kind, state, "unknown", "none")
    if (result := results.first(name, JUDGEMENT)) is not None:
        return _of_result(session, experiment, state, result)
    try:
        result = _judged(results, experiment, stage, failed)
    except Exception as error:
        # checks of a kind are foreign code to a session: they end this verdict alone
        text = f"the checks broke: {type(error).__name__}: {error}"
        cause = "this tells nothing about the record: report it, with the session"
        finding = Finding(f"step {JUDGEMENT}", "note", text, cause)
        return Verdict(name, kind, "failed", "unknown", "undecided", (finding,), causes=(cause,))
    return _of_result(session, experiment, state, result)


def _judged(results: Results, experiment: Experiment, stage: Stage, failed: Sequence[Outcome], **more: Any) -> Any:
    """Judge an experiment anew by the results that there are; None takes the place of those that are not."""
    plan, name = results.plan, TaskId(experiment.name, stage.name)
    given = results.values(plan.tasks[name].arguments, may_lack=True)
    context = context_of(plan, Store(plan.session.folder), name, failed)
    return function(stage.function)(*given, settings=experiment.settings, context=context, **more)


def _of_result(session: Session, experiment: Experiment, state: str, result: Any) -> Verdict:
    from labpipe.judging import from_json
    from pipelines.experiments.shared.judgements import suspected

    judged: Judgement = from_json(result.attrs["judgement"])
    findings = tuple(placed(session, experiment, f) for f in judged.findings)
    head = (experiment.name, experiment.kind, state, judged.believable, str(result.attrs["model"]))
    return Verdict(*head, findings, judged.n_made, judged.causes, tuple(suspected(result)))


def placed(session: Session, experiment: Experiment, finding: Finding) -> Finding:
    """Find the line of a setting as the files are now, and its text; of a recording, where session.toml names it."""
    finding = of_record(session, finding)
    line = finding.line
    if line is None and not finding.file:
        name, lines = finding.setting, experiment.lines
        while name and name not in lines:
            name = name.rpartition(".")[0]
        finding, line = replace(finding, file=FILE_NAME), lines.get(name, lines.get(""))
    elif line is None and finding.setting:
        with contextlib.suppress(LabpipeError, KeyError):
            line = parse(session.path(finding.file)).line(tuple(finding.setting.split(".")))
    if line is None:
        at = next((one.line for one in named_files(session) if one.line and one.name == finding.file), None)
        return finding if at is None else replace(finding, value=f"named in {FILE_NAME}:{at}")
    text, path, encoding = "", session.path(finding.file), "utf-8"
    with contextlib.suppress(LabpipeError):
        encoding = survey(path).encoding
    with contextlib.suppress(OSError), path.open(encoding=encoding, errors="replace") as lines_:
        text = next(islice(lines_, line - 1, None), "")
    return replace(finding, line=line, value=shorten(text.strip(), _LONGEST_LINE, placeholder=" …"))


def _with_session(results: Results, verdicts: Iterable[Verdict]) -> tuple[Verdict, ...]:
    """Add the findings of the session as a whole to the verdicts on its experiments, and its suspects."""
    made, session, common, differ = list(verdicts), results.plan.session, "", set[str]()
    found = session_findings(session) if made else {}
    if any(one.model == "differs" for one in made):
        # an experiment or a record that all that differ name, and no other that agrees
        rows = (row for row in results.plan.rows if row.stage == JUDGEMENT)
        found_by = ((row.experiment, results.up_to_date(row.task)) for row in rows)
        model = {name: result.attrs["model"] for name, result in found_by if result is not None}
        differ = {name for name, word in model.items() if word == "differs"}
        users: dict[str, set[str]] = {}
        for name in (name for name, word in model.items() if word in ("agrees", "differs")):
            texts = (text for _, text, _ in every_setting(results.experiments[name].settings) if isinstance(text, str))
            for text in (text for text in texts if text.startswith(REFERENCE) or "/" in text):
                users.setdefault(text.removeprefix(REFERENCE), set()).add(name)
        named = " or ".join(sorted(text for text, some in users.items() if some == differ))
        if named and len(differ) >= SEVERAL:
            common = f"all {len(differ)} experiments that name {named} differ and no other: it is probably wrong itself"
    for i, one in enumerate(made):
        experiment = session.experiments[one.experiment]
        more = [placed(session, experiment, f) for f in found.get(one.experiment, ())]
        known = {(f.file, f.line, f.level) for f in one.findings if f.line is not None}
        extra = tuple(f for f in more if f.check == TWO_VALUES or (f.file, f.line, f.level) not in known)
        is_worse = one.believable in ("yes", "unknown") and any(f.level == "doubtful" for f in extra)
        believable = "doubtful" if is_worse else one.believable
        suspects, findings = one.suspects, (*one.findings, *extra)
        if one.model == "differs":
            is_of_all = common and one.experiment in differ
            suspects = (*([common] if is_of_all else ()), *_suspects(results, experiment, one))
        made[i] = replace(one, believable=believable, findings=findings, suspects=suspects)
    return tuple(made)


def _suspects(results: Results, experiment: Experiment, one: Verdict) -> tuple[str, ...]:
    """Explain a model that differs by what the whole session knows: materials of its DMA, values of other experiments.

    Values that other experiments state otherwise come first where nothing else is plausible.
    """
    from pipelines.experiments.shared.judgements import suspected

    stage = next(s for s in KINDS[experiment.kind].stages if s.name == JUDGEMENT)
    rows = [row for row in results.plan.rows if row.stage == _CURVE and row.experiment not in experiment.refers_to]
    curves = {row.experiment: curve for row in rows if (curve := results.up_to_date(row.task)) is not None}
    result = results.first(experiment.name, JUDGEMENT)
    if curves and hasattr(function(stage.function), "inputs"):  # made by judging(), which takes others
        with contextlib.suppress(Exception):  # of foreign code: the suspects of the experiment itself remain
            result = _judged(results, experiment, stage, (), others=curves)

    def with_line(setting: re.Match[str]) -> str:  # that a sentence names in brackets
        line = experiment.lines.get(setting[1])
        return setting[0] if line is None else f"({setting[1]}, line {line} of {FILE_NAME})"

    told = one.suspects if result is None else suspected(result)
    told = [re.sub(r"\(([\w.\[\]]+)\)", with_line, text) for text in told]
    unusual = unusual_values(results.plan.session, experiment.name)
    is_explained = result is None or result.attrs.get("is_explained", 1)  # one of earlier code may be kept
    return (*told, *unusual) if is_explained else (*unusual, *told)
