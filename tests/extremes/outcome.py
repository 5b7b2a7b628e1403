"""Outcome of an extreme case, and the tally of many."""

import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from labpipe.errors import InputError, LabpipeError


@dataclass(frozen=True, slots=True)
class Outcome:
    """How far an answer is from an independent one, in units of what is allowed: right up to 1.

    ``what`` is the bound that came nearest to being broken, ``refusal`` why the case was not computed.
    """

    share: float
    what: str
    refusal: str = ""


Case = Callable[[np.random.Generator], Outcome]


@dataclass(frozen=True, slots=True)
class Tally:
    """Many cases of one family: ``refused`` counts by reason, ``wrong`` are the seeds of cases that broke a bound."""

    right: int
    refused: Counter[str]
    wrong: tuple[int, ...]
    worst: Outcome


def worst(*looks: tuple[float, str]) -> Outcome:
    """Return the look whose share of its bound is largest; NaN counts as infinite."""
    share, what = max(looks, key=lambda look: np.nan_to_num(look[0], nan=np.inf, posinf=np.inf))
    return Outcome(float(np.inf if np.isnan(share) else share), what)


@contextmanager
def silently() -> Iterator[None]:
    """Take what is said to the user as said; warnings of arithmetic stay what they are."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", UserWarning)
        yield


def run_case(case: Case, seed: int) -> Outcome:
    """Compute one case; a refusal with a reason is an answer, another error is not."""
    try:
        return case(np.random.default_rng(seed))
    except InputError as error:
        return Outcome(0.0, "", _reason(error))
    except LabpipeError as error:
        return Outcome(np.inf, f"{type(error).__name__}: {error}")


def run_family(case: Case, count: int, first_seed: int = 0) -> Tally:
    """Compute the cases with the seeds from ``first_seed`` on."""
    refused: Counter[str] = Counter()
    wrong: list[int] = []
    right, top = 0, Outcome(0.0, "")
    for seed in range(first_seed, first_seed + count):
        outcome = run_case(case, seed)
        if outcome.refusal:
            refused[outcome.refusal] += 1
            continue
        if outcome.share <= 1.0:
            right += 1
        else:
            wrong.append(seed)
        if outcome.share > top.share:
            top = outcome
    return Tally(right, refused, tuple(wrong), top)


def _reason(error: LabpipeError) -> str:
    """Return the message without its numbers, so that reasons can be counted."""
    text = str(error).split(";")[0]
    words = [word for word in text.split() if not any(sign.isdigit() for sign in word)]
    return " ".join(words)[:90]
