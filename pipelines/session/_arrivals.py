"""Check by its content whether a file that has stopped growing is complete.

A copy may pause for longer than anybody waits. Every format says in its own way how much there
should be: a number of rows, an end mark, a table of frames; so the file is read as the analysis
would read it.
"""

import warnings
from pathlib import Path
from typing import Any

from labpipe.errors import LabpipeError
from labpipe.workflow.document import parse
from labpipe.workflow.exclusions import concerning, files_of
from labpipe.workflow.graph import FILE
from labpipe.workflow.session import Experiment
from pipelines.experiments import KINDS, function

_PNG_END = b"IEND\xaeB`\x82"
_READINGS = "readings"
"""Name of the stage that reads one file of an experiment, with the options in its settings."""


def missing_part(experiment: Experiment, path: Path) -> str | None:
    """Return the missing part of a file of an experiment, or None when it is complete."""
    import xarray as xr

    import instruments

    if path.suffix.lower() == ".png":
        return None if path.read_bytes().endswith(_PNG_END) else f"{path}: the picture has no end"
    try:
        with warnings.catch_warnings(action="ignore"):  # shown when the file is processed
            if path.suffix.lower() == ".toml":
                parse(path)
                return None
            own = [
                (field, name) for field, name in files_of(experiment.settings) if path.as_posix().endswith(f"/{name}")
            ]
            name, inputs = own[0][1] if own else "", {f"{FILE}{field.partition('[')[0]}" for field, _ in own}
            stages = (s for s in KINDS[experiment.kind].stages if s.name == _READINGS and len(s.inputs) == 1)
            reader: Any = next((function(s.function) for s in stages if s.inputs[0] in inputs), None)
            settings = concerning(experiment.settings, [name])
            found: Any = reader(path, settings=settings) if reader else instruments.read(path)
    except LabpipeError as error:
        return str(error)
    if isinstance(found, xr.Dataset):
        return None
    absent = int((~found.valid).sum())
    return f"{path}: {absent} of {len(found)} frames are not there" if absent else None
