"""Where a result comes from: program, versions, parameters and raw files; nothing of the clock."""

import platform
import shutil
import subprocess
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from labpipe.installation import __version__
from labpipe.workflow.code import LIBRARIES, version
from labpipe.workflow.graph import TaskId, lineage
from labpipe.workflow.plan import Plan
from labpipe.workflow.store import key_of


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
    git = shutil.which("git")
    if git is None or not any((parent / ".git").exists() for parent in folder.parents):
        return None
    command = [git, "-C", str(folder), "describe", "--always", "--exclude=*", "--abbrev=40", "--dirty=+"]
    try:  # a repository on a share that does not answer must not stop a run
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
