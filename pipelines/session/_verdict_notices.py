"""First sentences of the pages of several experiments: how many can be believed, and where the model agrees."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from labpipe.report import Level, Notice
from pipelines.experiments.shared.judgements import capitalised
from pipelines.session._session_checks import NAMED

if TYPE_CHECKING:
    from pipelines.session._verdicts import Verdict

LEVELS: dict[str, Level] = {"yes": "ok", "doubtful": "warning", "impossible": "error"}
_WORDS = {"yes": "the record is believable", "unknown": "whether the record is believable is not known"}
_STALE, _WAITING = "without a verdict that is up to date", "waiting for settings"


def belief(verdicts: Mapping[str, Verdict], names: Iterable[str], waiting: Iterable[str] = ()) -> Notice:
    """Say how many of the named experiments of a session can be believed, and name the others."""
    words = {name: verdicts[name].believable.replace("unknown", "not known") if name in verdicts else _STALE
             for name in names} | dict.fromkeys(waiting, _WAITING)  # fmt: skip
    n, known = len(words), list(words.values())
    sure = known.count("yes")
    if sure == n:
        return Notice("ok", f"All {n} experiments are believable." if n > 1 else "The experiment is believable.")
    worst: Level = "error" if "impossible" in known else "warning" if "doubtful" in known else "info"
    text = f"{sure} of {n} experiment{'s' * (n > 1)} {'is' if n == 1 or sure == 1 else 'are'} believable."
    return Notice(worst, f"{text} {_others(words, ('impossible', 'doubtful', 'not known', _STALE, _WAITING))}")


def agreement(models: Mapping[str, str]) -> Notice | None:
    """Say in how many experiments the model agrees, and name the others; None where none is compared."""
    words = {name: model for name, model in models.items() if model != "none"}
    if not words:
        return None
    n, known = len(words), list(words.values())
    level: Level = "warning" if "differs" in known else "info" if "undecided" in known else "ok"
    text = f"The model agrees in {known.count('agrees')} of {n} experiment{'s' * (n != 1)}."
    return Notice(level, f"{text} {_others(words, ('differs', 'undecided'))}".strip())


def _others(words: Mapping[str, str], shown: Iterable[str]) -> str:
    """Name the experiments that have each of some words, five at most; empty where there are none."""
    parts = []
    for word in shown:
        if names := [name for name, own in words.items() if own == word]:
            more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
            parts.append(f"{word}: {', '.join(names[:NAMED])}{more}")
    return as_sentence("; ".join(parts)) if parts else ""


def each(names: Iterable[str], verdicts: Mapping[str, Verdict]) -> Iterator[Notice]:
    """Say of each named experiment whether it can be believed and agrees, with the gravest reason."""
    for name in names:
        if (one := verdicts.get(name)) is None:
            yield Notice("info", f"{name}: no verdict that is up to date.")
            continue
        said = _WORDS.get(one.believable, f"the record is {one.believable}")
        model = {"none": "", "undecided": "; whether the model agrees is undecided"}
        said += model.get(one.model, f"; the model {one.model}")
        level = LEVELS.get(one.believable, "info")
        if level == "ok":
            level = {"differs": "warning", "undecided": "info"}.get(one.model, level)  # type: ignore[assignment]
        grave = [finding for finding in one.findings if finding.level == one.believable]
        reason = f" {as_sentence(grave[0].message)}" if grave else ""
        # a model may differ because the record is wrong
        likely = one.cause if grave else next(iter(one.suspects), "")
        causes = f" Likely: {likely.rstrip('.')}." if likely else ""
        yield Notice(level, f"{name}: {said}.{reason}{causes}")


def judgement(believable: str, model: str) -> tuple[str, Level]:
    """Return a verdict in a few words, and its level."""
    if believable != "yes":
        return believable, LEVELS.get(believable, "warning")
    if model == "none":
        return "believable", "ok"
    return f"believable, model {model}", "warning" if model == "differs" else "ok"


def as_sentence(text: str) -> str:
    """Begin and end a text as a sentence."""
    return f"{capitalised(text).rstrip('.')}."
