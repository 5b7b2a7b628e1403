"""Properties of the machine that affect run times; neither its name nor any path."""

import os
import platform
import re
from pathlib import Path
from typing import Any

from labpipe.workflow.engines import processors
from labpipe.workflow.provenance import program

_CPU_FACTS = Path("/proc/cpuinfo")
_MEMORY_FACTS = Path("/proc/meminfo")
#: Settings of the libraries' own threads; they decide what a ratio between methods means.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def facts() -> dict[str, Any]:
    """Return processor, cores, memory, system, versions and thread settings.

    Examples
    --------
    >>> facts()["cores"] >= 1
    True
    """
    about = program()
    kilobytes = _first(_MEMORY_FACTS, r"^MemTotal:\s*(\d+) kB$")
    return {
        "processor": _first(_CPU_FACTS, r"^model name\s*:\s*(.+)$") or platform.machine(),
        "cores": processors(),
        "memory_bytes": int(kilobytes) * 1024 if kilobytes else None,
        "system": platform.system(),
        "architecture": platform.machine(),
        "python": about["python"],
        "labpipe": about["labpipe"],
        "commit": about["git"],
        "libraries": about["libraries"],
        "threads": {name: os.environ[name] for name in _THREADS if name in os.environ},
    }


def _first(path: Path, pattern: str) -> str | None:
    try:
        found = re.search(pattern, path.read_text(encoding="utf-8"), re.MULTILINE)
    except OSError:
        return None
    return found.group(1).strip() if found else None
