"""Two small kinds of experiment whose stages are quick, and a folder to run them in."""

import os
import signal
import sys
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import msgspec

from labpipe.errors import InputError
from labpipe.schema import Schema, Variable
from labpipe.workflow.fields import POSITIVE, ExperimentName, File, Length
from labpipe.workflow.graph import Stage
from labpipe.workflow.plan import plan
from labpipe.workflow.results import Results
from labpipe.workflow.session import Session, load

HERE = "toy_laboratory"


class Sphere(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    radius: Annotated[Length, POSITIVE]


class Drop(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    laser: list[File]
    sphere: Sphere
    gain: float = 1.0
    trouble: str = ""
    material: ExperimentName | None = None
    notes_file: File | None = None


class Dma(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    sweep: File
    trouble: str = ""


def _dataset(values: Any, **attributes: Any) -> Any:
    import numpy as np
    import xarray as xr

    variable = ("time", np.asarray(values, float), {"units": "m", "long_name": "position"})
    return xr.Dataset({"z": variable}, attrs=attributes)


def _calls(settings: Any, stage: str) -> None:
    """Count a call by a line in a file outside the session, where a test asks for it."""
    if counter := os.environ.get("TOY_CALLS"):
        with Path(counter).open("a") as stream:
            stream.write(stage + "\n")


def _trouble(settings: Any, stage: str, path: Path | None = None) -> None:
    """Fail in the way that the settings ask for, as "STAGE:HOW"."""
    where, _, how = settings.trouble.partition(":")
    if where != stage:
        return
    if how == "written once" and path is not None:
        text = path.read_text()
        if not text.endswith("\n9.0"):
            path.write_text(text + "\n9.0")
        return
    if how == "die" or (how == "die once" and not Path(os.environ["TOY_DIED"]).exists()):
        if how == "die once":
            Path(os.environ["TOY_DIED"]).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if how == "exit":
        sys.exit(3)
    if how == "sleep":
        time.sleep(60)
    if how == "warn":
        warnings.warn("the record is short", UserWarning, stacklevel=2)
    errors = {"number": ZeroDivisionError("by zero"), "refuse": InputError("no sweep was recorded")}
    if how in errors or how not in ("give a list", "die once", "units", "warn"):
        raise errors.get(how, ValueError(how))


def read(path: Path, *, settings: Drop) -> Any:
    _calls(settings, "read")
    _trouble(settings, "read", path)
    values = [float(line) for line in path.read_text().split()]
    time.sleep(float(os.environ.get("TOY_DELAY", "0")))
    work = {"frames_read": len(values), "frames_total": 10, "seconds": time.time()}
    return _dataset(values, work=work, empty=None)


def scale(dataset: Any, *, settings: Drop) -> Any:
    _calls(settings, "scale")
    _trouble(settings, "scale")
    time.sleep(float(os.environ.get("TOY_DELAY", "0")))
    result = dataset * settings.gain
    result["z"].attrs = {"units": "m", "long_name": "position"}
    if settings.trouble == "scale:give a list":
        return [1.0]
    return result.drop_vars("z") if settings.trouble == "scale:units" else result


def mean(datasets: list[Any], material: Any, *, settings: Drop, full: bool) -> Any:
    _calls(settings, "mean")
    _trouble(settings, "mean")
    total = sum(d["z"].to_numpy() for d in datasets) / len(datasets) + settings.sphere.radius.value
    if material is not None:
        total = total + material["z"].to_numpy().sum()
    return _dataset(total, full=full)


def page(datasets: list[Any], result: Any, *, settings: Drop, context: Any) -> str:
    _calls(settings, "page")
    _trouble(settings, "page")
    parts = [
        context.title,
        repr([None if d is None else d["z"].values.tolist() for d in datasets]),
        "missing" if result is None else repr(result["z"].values.tolist()),
        repr(context.ledger),
        repr(context.warnings),
        repr(context.failures),
        repr(context.provenance),
    ]
    return "\n".join(["<!doctype html>", *parts, ""])


def sweep(path: Path, *, settings: Dma) -> Any:
    _calls(settings, "sweep")
    _trouble(settings, "sweep")
    return _dataset([float(path.read_text())])


DROP = (
    Stage("page", f"{HERE}:page", ("scale", "mean"), ("*",), output="page", context=True),
    Stage("mean", f"{HERE}:mean", ("scale", "other:material/curve"), ("sphere.radius",), schema="toy", shortcuts=True),
    Stage("scale", f"{HERE}:scale", ("read",), ("gain", "trouble"), per="recording", over="laser", schema="toy"),
    Stage(
        "read", f"{HERE}:read", ("file:laser",), ("trouble",), per="recording", over="laser", summary="read the numbers"
    ),
)
DMA = (Stage("curve", f"{HERE}:sweep", ("file:sweep",), ("trouble",)),)

STAGES: Mapping[str, tuple[Stage, ...]] = {"drop": DROP, "dma": DMA}
KINDS: Mapping[str, type[msgspec.Struct]] = {"drop": Drop, "dma": Dma}
SCHEMAS = {"toy": Schema("toy", {"z": Variable(("time",), "m")})}

TOML = """\
labpipe = 1
[session]
title = "Toys"
[experiments.acrylic]
kind = "drop"
laser = ["laser/r1.txt", "laser/r2.txt"]
sphere.radius = "9.5 mm"
[experiments.nbr]
kind = "drop"
laser = ["laser/r3.txt"]
sphere.radius = "5 mm"
material = "rubber"
[experiments.rubber]
kind = "dma"
sweep = "dma.txt"
"""
SMALL = TOML.replace(TOML[TOML.index("[experiments.acrylic]") : TOML.index("[experiments.nbr]")], "")
"""An experiment and the one that it needs: of every step one."""


def make_session(folder: Path, toml: str = TOML) -> Session:
    """Write a session folder and load it."""
    (folder / "laser").mkdir(parents=True, exist_ok=True)
    for number in (1, 2, 3):
        text = "\n".join(str(number * k / 7) for k in range(5))
        (folder / "laser" / f"r{number}.txt").write_text(text)
    (folder / "dma.txt").write_text("0.25")
    return reload_session(folder, toml)


def reload_session(folder: Path, toml: str = TOML) -> Session:
    (folder / "session.toml").write_text(toml)
    return load(folder, KINDS)


def opened(session: Session, experiment: str, stage: str, recording: str | None = None) -> Any:
    """Return a result that is up to date."""
    made = plan(session, STAGES, [f"{experiment}/{stage}"], [experiment], keep=None)
    return Results(made).result(experiment, stage, recording)


def contents(session: Session) -> dict[str, bytes]:
    """Everything that must not depend on how it was made: results and pages."""
    paths = [p for p in session.folder.rglob("*") if p.suffix in (".nc", ".html")]
    return {p.relative_to(session.folder).as_posix(): p.read_bytes() for p in sorted(paths)}
