"""Mistakes as small edits of the text of a Mach-1 file, and what its judgement says."""

import re
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from labpipe.errors import LabpipeError
from labpipe.judging import Judgement
from labpipe.workflow.context import Context, Failed

_ROW = re.compile(r"^-?[0-9.]+\t-?[0-9.]+\t-?[0-9.]+$", re.MULTILINE)

Row = tuple[float, float, float]

_NOISE = np.random.default_rng(4)
WRONG_COLUMNS: tuple[tuple[Callable[[float, float, float], Row], str], ...] = (
    (lambda t, x, f: (t, f, x), "position and force are swapped"),
    (lambda t, x, f: (t, x, -f), "the sign of the column of the force"),
    (lambda t, x, f: (t, -x, f), "the sign of the column of the position"),
    (lambda t, x, f: (1000 * t, x, f), "the column of the time is 1000 times too large: in ms"),
    (lambda t, x, f: (2 * t, x, f), "the column of the time is 2 times too large"),
    (lambda t, x, f: (t, 1000 * x, f), "the column of the position is 1000 times too large: in µm"),
    (lambda t, x, f: (t, x, 101.97 * f), "the column of the force is in gf or mN"),
    (lambda t, x, f: (t, x, 1000 * f), "the column of the force is in gf or mN"),
    (lambda t, x, f: (t, x, max(f, -14.0)), "saturated"),
    (lambda t, x, f: (t, x, -0.35), "the load cell was dead"),
    (lambda t, x, f: (t, x, -0.35 + 0.01 * _NOISE.standard_normal()), "the load cell was dead"),
)
"""What makes the columns of time [s], position [mm] and force [N] wrong, and how it is told."""


def columns(text: str, change: Callable[[float, float, float], Row]) -> str:
    """Change every row of time [s], position [mm] and force [N]."""

    def changed(found: re.Match[str]) -> str:
        return "\t".join(f"{v:.6f}" for v in change(*map(float, found[0].split("\t"))))

    return _ROW.sub(changed, text)


def line_of(text: str, part: str, after: str = "") -> int:
    """Return the number of the first line that holds a text, behind another."""
    begin = text.index(part, text.index(after))
    return text[:begin].count("\n") + 1


class Steps:
    """Run stages one after the other and keep why some gave no result, as a run does."""

    def __init__(self) -> None:
        self.failures: list[Failed] = []

    def __call__(self, stage: str, made: Callable[[], Any], recording: str | None = None) -> Any:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # a run counts them; here the judgement is asked
                return made()
        except LabpipeError as error:
            self.failures.append(Failed(stage, recording, str(error)))
            return None

    def context(self, kind: str) -> Context:
        return Context("nbr", kind, "", "", "", True, failures=tuple(self.failures))


def said(judged: Judgement) -> str:
    """Return checks, messages and causes as one text."""
    return "\n".join(f"{f.level} {f.check}: {f.message} ({f.cause})" for f in judged.findings)
