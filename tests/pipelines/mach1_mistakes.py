"""Stages of a Mach-1 file run one after the other, and the words of its judgement."""

import warnings
from collections.abc import Callable
from typing import Any

from labpipe.errors import LabpipeError
from labpipe.judging import Judgement
from labpipe.workflow.context import Context, Failed


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
