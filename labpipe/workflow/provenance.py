"""Where a result comes from: program, versions, parameters, raw files, and the run behind it; nothing of the clock."""

import platform
import subprocess
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from labpipe.installation import __version__
from labpipe.workflow.code import LIBRARIES, version
from labpipe.workflow.context import Context, Outcome, Warned, summarise
from labpipe.workflow.graph import TaskId, lineage
from labpipe.workflow.plan import Plan, code_changed
from labpipe.workflow.store import Store, key_of


def program() -> dict[str, Any]:
    """Versions of labpipe, Python and the libraries, and the state of labpipe's own repository."""
    return {
        "labpipe": __version__,
        "git": git_state(Path(__file__).parents[1]),
        "python": platform.python_version(),
        "libraries": {name: version(name) for name in LIBRARIES},
    }


@cache
def git_state(folder: Path) -> str | None:
    """Return the commit that a folder is at, with ``+`` when files differ; None outside git."""
    if not any((parent / ".git").exists() for parent in folder.parents):
        return None
    command = ["git", "-C", str(folder), "describe", "--always", "--exclude=*", "--abbrev=40", "--dirty=+"]
    try:  # there may be no git, and a repository on a share that does not answer must not stop a run
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


def of_task(about_program: Mapping[str, Any], plan: Plan, task: TaskId) -> dict[str, Any]:
    """Return everything that one result depends on.

    ``program``; ``stage``, ``key`` and ``parameters``; ``stages``: digest of the code of every stage behind it;
    ``inputs``: name, size and SHA-256 of every raw file.
    """
    own = plan.keys[task].ingredients
    stages: dict[str, str] = {}
    files: dict[str, dict[str, Any]] = {}
    for key in (plan.keys[name] for name in lineage(plan.tasks, task)):
        kind, stage = key.ingredients["kind"], key.ingredients["stage"]
        # that of another kind of experiment is named with its kind
        stages[stage if kind == own["kind"] else f"{kind}/{stage}"] = key_of(key.ingredients.get("code", {}))[:16]
        files |= {file["name"]: file for file in key.files}
    return {
        "program": dict(about_program),
        "stage": own["stage"],
        "function": own["function"],
        "key": plan.keys[task].value,
        "parameters": own["parameters"],
        "full": own.get("full", False),
        "stages": stages,
        "inputs": [files[name] for name in sorted(files)],
    }


def context_of(
    plan: Plan, store: Store, task: TaskId, failed: Iterable[Outcome], about: Mapping[str, Any] = MappingProxyType({})
) -> Context:
    """Return the context of a task, by the results behind it, those that ``failed``, and its origin."""
    keys, behind, own = plan.keys, lineage(plan.tasks, task)[:-1], plan.keys[task].ingredients
    failures = {one.task: one for one in failed}
    found = {n: store.record(keys[n].value or "") for n in behind if n not in failures}
    records = {name: record for name, record in found.items() if record is not None}
    return Context(
        **own["session"],
        kind=own["kind"],
        ledger=summarise((n.experiment, n.stage, record.work) for n, record in records.items()),
        warnings=tuple(
            Warned(n.seen_from(task), n.recording, w.category, w.text, w.count)
            for n, record in records.items()
            for w in record.warnings
        ),
        # without what another run has otherwise
        failures=tuple(replace(f, stage=n.seen_from(task), details="", seconds=0.0) for n, f in failures.items()),
        provenance=about,
        kept={n.seen_from(task): code_changed(keys[n].kept) for n in behind if keys[n].kept},
    )
