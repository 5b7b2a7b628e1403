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
from labpipe.workflow.graph import Task, TaskId, ancestors
from labpipe.workflow.plan import Key
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


def of_task(
    about_program: Mapping[str, Any], tasks: Mapping[TaskId, Task], keys: Mapping[TaskId, Key], task_id: TaskId
) -> dict[str, Any]:
    """Return everything that one result depends on.

    ``program``; ``stage``, ``key`` and ``parameters``; ``stages``: digest of the code of every stage behind it;
    ``inputs``: name, size and SHA-256 of every raw file.
    """
    task, key = tasks[task_id], keys[task_id]
    behind = [*ancestors(tasks, task_id), task_id]
    stages: dict[str, str] = {}
    files: dict[str, dict[str, Any]] = {}
    for found in (keys[name].ingredients for name in behind):
        # that of another kind of experiment is named with its kind
        of_other = "" if found["kind"] == key.ingredients["kind"] else f"{found['kind']}/"
        stages[f"{of_other}{found['stage']}"] = key_of(found.get("code", {}))[:16]
        files |= {file["name"]: file for argument in found["inputs"] for file in argument.get("files", ())}
    return {
        "program": dict(about_program),
        "stage": task.stage.name,
        "function": task.stage.function,
        "key": key.value,
        "parameters": key.ingredients["parameters"],
        "full": key.ingredients.get("full", False),
        "stages": stages,
        "inputs": [files[name] for name in sorted(files)],
    }
