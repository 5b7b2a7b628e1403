"""What a page says would have shown, put to the test: an error of that size in one stated value.

``python -m tests.pipelines.detection --seeds 40`` records sessions as :mod:`tests.pipelines.deviations`
does, states one value wrongly by what the right session's verdict calls detectable, upwards or
downwards by turns, and counts how often the comparison shows it.
"""

import argparse
import re
import shutil
import sys
import tempfile
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from labpipe import files
from labpipe.workflow.runner import run
from pipelines.session import SCHEMAS, STAGES, open_session, process, result
from tests.pipelines.deviations import write_specimens

SESSION = "session.toml"
_LASER, _CELL, _CAMERA = (f"calibration/{name}.toml" for name in ("laser", "load_cell", "camera_under"))
_SCALE = r'(\nscale = ")([\d.]+)'
SHOWN, _FAR = 0.05, 0.3  # p below which an error is shown; share of a value beyond which it is another specimen


def changed(pattern: str, to: Callable[[float], float], section: str = "") -> Callable[[str], str]:
    """Return an edit that changes the number of every match, of one experiment or everywhere."""

    def edit(text: str) -> str:
        parts = re.split(r"(?m)^(?=\[experiments\.\w+\]$)", text)
        count = 0
        for i, part in enumerate(parts):
            if not section or part.startswith(f"[experiments.{section}]"):
                parts[i], found = re.subn(pattern, lambda m: f"{m[1]}{to(float(m[2])):.9g}", part)
                count += found
        assert count, pattern
        return "".join(parts)

    return edit


class Wrong(NamedTuple):
    """Where an input of a comparison is stated, and in what unit; relative where there is none."""

    experiment: str
    input: str
    file: str
    pattern: str
    unit: float | None = None
    section: str = ""


WRONG = (
    Wrong("drop", "height", SESSION, r'(\nheight = ")([\d.]+)', 1e-3, "drop"),
    Wrong("drop", "scale of length (gain and inclination)", _LASER, _SCALE),
    Wrong("drop", "mass", SESSION, r'(\nmass = ")([\d.]+)', None, "drop"),
    Wrong("drop", "temperature", SESSION, r'(\ntemperature = ")([\d.]+)', 1.0, "drop"),
    Wrong("drop", "modulus", SESSION, _SCALE),
    Wrong("static", "modulus", SESSION, _SCALE),
    Wrong("static", "loads", SESSION, r'(mass = ")([\d.]+)', None, "static"),
    Wrong("relaxation", "modulus of the rubber", SESSION, _SCALE),
    Wrong("relaxation", "scale of force", _CELL, _SCALE),
    Wrong("relaxation", "tip radius", SESSION, r'(\nradius = ")([\d.]+)', None, "relaxation"),
    Wrong("harmonic", "modulus of the rubber", SESSION, _SCALE),
    Wrong("harmonic", "scale of force", _CELL, _SCALE),
    Wrong("harmonic", "temperature", SESSION, r'(\ntemperature = ")([\d.]+)', 1.0, "harmonic"),
    Wrong("harmonic", "delay of the force", _CELL, r'(delay = ")([\d.]+)', 1e-3),
    Wrong("film", "scale of the image", _CAMERA, r'(reference_length = ")([\d.]+)'),
    Wrong("film", "mass", SESSION, r'(\nmass = ")([\d.]+)', None, "film"),
)


class Shown(NamedTuple):
    """The error that was stated, the probability of what is seen, and the words for the model and the record."""

    error: float
    p: float
    model: str
    believable: str


def judge(folder: Path, experiments: list[str]) -> None:
    """Compute the judgements on some experiments; the page of the session, which no one reads here, stays as it is."""
    run(open_session(folder), STAGES, targets=["judgement"], only=experiments, jobs=0, schemas=SCHEMAS)


def shown(folder: Path, room: Path, wrong: Wrong, share: float) -> Shown | None:
    """State a value wrongly by a share of what would show, in a copy; None where that is another specimen."""
    right = result(folder, wrong.experiment, "judgement").sel(input=wrong.input)
    error = share * float(right["detectable" if wrong.unit is None else "detectable_error"])
    if wrong.unit is None and abs(error) > _FAR:
        return None
    there = shutil.copytree(folder, room / "wrong")
    text = (there / wrong.file).read_text("utf-8")
    to = (lambda v: v * (1 + error)) if wrong.unit is None else (lambda v: v + error / (wrong.unit or 1.0))
    files.write_text(there / wrong.file, changed(wrong.pattern, to, wrong.section)(text))
    judge(there, [wrong.experiment])
    said = result(there, wrong.experiment, "judgement")
    shutil.rmtree(there)
    return Shown(error, float(said["p"]), said.attrs["model"], said.attrs["believable"])


def _told(folder: Path, seed: int) -> Iterator[tuple[Wrong, Shown]]:
    known = (folder / SESSION).read_text("utf-8")
    for wrong in WRONG:
        if f"[experiments.{wrong.experiment}]" in known:
            # half of the seeds of every polymer upwards
            found = shown(folder, folder.parent, wrong, 1.0 if seed // 4 % 2 else -1.0)
            if found is not None:
                yield wrong, found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    chosen = parser.parse_args()
    found: dict[Wrong, list[Shown]] = defaultdict(list)
    for seed in range(chosen.first, chosen.first + chosen.seeds):
        with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            folder = Path(name) / "right"
            write_specimens(folder, seed)
            process(folder, ["judgement"], jobs=0)
            for wrong, said in _told(folder, seed):
                found[wrong].append(said)
    for wrong, each in found.items():
        errors = sorted(abs(one.error) for one in each)
        seen, differs = sum(one.p < SHOWN for one in each), sum(one.model == "differs" for one in each)
        sys.stdout.write(
            f"| {wrong.experiment} | {wrong.input} | {len(each)} | {errors[0]:.2g} to {errors[-1]:.2g} "
            f"| {seen} | {differs} |\n"
        )


if __name__ == "__main__":
    main()
