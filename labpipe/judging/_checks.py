"""One check of a record: two ways to the same quantity, or a quantity against a law."""

from dataclasses import dataclass, field
from math import copysign, hypot, inf, isfinite, log, nan
from typing import Literal, TypedDict, Unpack

Level = Literal["impossible", "doubtful", "note"]
"""How much a finding weighs."""

FLAGS = {"yes": 1, "unknown": 2, "doubtful": 3, "impossible": 4}
"""Verdicts as the primary flags of QARTOD, for exported netCDF (``flag_values``)."""

IMPOSSIBLE = 10.0
"""Standard uncertainties beyond which two ways to one quantity contradict each other."""
DOUBTFUL = 4.0
"""Standard uncertainties beyond which they are doubtful: once in 16,000 by chance, so that the
twenty checks of a record raise a false alarm in 0.1 % of cases where uncertainties are right."""
BROKEN = 5.0
"""Standard uncertainties by which a law without exceptions must be broken to be broken."""


@dataclass(frozen=True, slots=True)
class Finding:
    """What is wrong with a record, its most likely cause, and where to look.

    Attributes
    ----------
    check : str
        Name of the check.
    level : "impossible", "doubtful" or "note"
    message : str
        What was seen and what was expected, with numbers.
    cause : str
        The most likely mistake; empty when nothing singles one out.
    file : str
        File of the session to look at, relative to it; empty for session.toml.
    line : int or None
        Line of that file, where it is known from its content.
    setting : str
        Dotted name in that file (``"sphere.radius"``; of session.toml below the experiment), from
        which the line is found when the finding is shown: lines move, names do not.
    """

    check: str
    level: Level
    message: str
    cause: str = ""
    file: str = ""
    line: int | None = None
    setting: str = ""


class Place(TypedDict, total=False):
    """Where to look and what for, as in :class:`Finding`."""

    cause: str
    file: str
    line: int | None
    setting: str


@dataclass(frozen=True, slots=True)
class Check:
    """One question to a record, and its answer.

    Attributes
    ----------
    name : str
        Such as ``"free-fall acceleration"``; causes refer to it.
    law : str
        The physical law or redundancy that it uses, in one sentence.
    message : str
        What was seen and what was expected.
    level : "impossible", "doubtful", "note" or None
        None where nothing is wrong.
    margin : float
        Difference in units of its standard uncertainty; NaN where that has no meaning.
    log_ratio, u_log_ratio : float
        Natural logarithm of seen over expected and its standard uncertainty; NaN where a factor
        would explain nothing. They tell causes apart.
    needs : str
        What would have to be stated or recorded for the check; empty when it was made.
    cause, file, line, setting
        As in :class:`Finding`, where the check itself knows them; nothing wrong has no cause.
    """

    name: str
    law: str
    message: str
    level: Level | None = None
    margin: float = nan
    log_ratio: float = nan
    u_log_ratio: float = nan
    needs: str = ""
    cause: str = ""
    file: str = field(default="", kw_only=True)
    line: int | None = field(default=None, kw_only=True)
    setting: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        if self.level is None:
            object.__setattr__(self, "cause", "")

    @property
    def is_made(self) -> bool:
        """Whether what the check needs was there."""
        return not self.needs


def compared(
    name: str,
    law: str,
    message: str,
    seen: float,
    u_seen: float,
    expected: float,
    u_expected: float,
    *,
    allowance: float = 0.0,
    degrees_of_freedom: float = inf,
    factor: bool = True,
    **place: Unpack[Place],
) -> Check:
    """Hold two ways to the same quantity against each other.

    Parameters
    ----------
    name, law, message : str
        See :class:`Check`.
    seen, expected : float
        In the same unit.
    u_seen, u_expected : float
        Standard uncertainties; what both share is taken out by the caller.
    allowance : float
        Largest systematic effect that the kind of experiment knows (such as drag), in the same
        unit: a smaller difference is never called impossible.
    degrees_of_freedom : float
        Behind the uncertainty (few repeats: Student's distribution).
    factor : bool
        Whether a wrong factor could explain a difference.
    **place
        ``cause``, ``file``, ``line`` and ``setting``; see :class:`Finding`.

    Returns
    -------
    Check
        Impossible beyond 10 u and the allowance, doubtful beyond 4 u.

    Examples
    --------
    >>> compared("acceleration", "g", "39.2 for 9.81", 39.2, 0.1, 9.81, 0.01).level
    'impossible'
    """
    u = hypot(u_seen, u_expected)
    if not (isfinite(seen) and isfinite(expected) and isfinite(u) and u > 0.0):
        return not_made(name, law, "finite values with uncertainties")
    difference = seen - expected
    margin = _as_normal(difference / u, degrees_of_freedom)
    level: Level | None = None
    if abs(margin) > IMPOSSIBLE and abs(difference) > allowance:
        level = "impossible"
    elif abs(margin) > DOUBTFUL and abs(difference) > allowance:
        level = "doubtful"
    is_ratio = factor and seen * expected > 0.0
    return Check(
        name,
        law,
        message,
        level,
        margin,
        log(seen / expected) if is_ratio else nan,
        hypot(u_seen / seen, hypot(u_expected, allowance / 2) / expected) if is_ratio else nan,
        **place,
    )


def bounded(
    name: str,
    law: str,
    message: str,
    value: float,
    u: float,
    *,
    at_least: float = -inf,
    at_most: float = inf,
    is_law: bool = True,
    **place: Unpack[Place],
) -> Check:
    """Hold a quantity against a law that knows no exception, such as 0 < e < 1.

    Parameters
    ----------
    name, law, message : str
        See :class:`Check`.
    value, u : float
        With standard uncertainty, at least that of the noise.
    at_least, at_most : float
        The law.
    is_law : bool
        False for a plausible range: beyond it a value is doubtful, never impossible.
    **place
        ``cause``, ``file``, ``line`` and ``setting``; see :class:`Finding`.

    Examples
    --------
    >>> bounded("restitution", "0 < e < 1", "1.195", 1.195, 2e-4, at_least=0.0, at_most=1.0).level
    'impossible'
    """
    if not (isfinite(value) and isfinite(u)):
        return not_made(name, law, "a finite value with its uncertainty")
    beyond = max(at_least - value, value - at_most)
    margin = copysign(inf, beyond) if u == 0.0 and beyond != 0.0 else beyond / u if u else 0.0
    level: Level | None = None
    if margin > BROKEN:
        level = "impossible" if is_law else "doubtful"
    elif margin > DOUBTFUL:
        level = "doubtful"
    return Check(name, law, message, level, margin, **place)


def stated(name: str, law: str, message: str, level: Level | None, **place: Unpack[Place]) -> Check:
    """Return a check whose answer is plain, such as that two files hold the same bytes."""
    return Check(name, law, message, level, **place)


def not_made(name: str, law: str, needs: str) -> Check:
    """Return a check that could not be made, with what it would need."""
    return Check(name, law, "", needs=needs)


def unfinished(name: str, law: str, message: str, cause: str) -> Check:
    """Return a check that could not be made because the run did not get through a step; it is told as a note."""
    return Check(name, law, message, "note", needs="a run that gets through this step", cause=cause)


def _as_normal(t: float, degrees_of_freedom: float) -> float:
    """Return the normal deviate that is as unlikely as a deviate of Student's distribution."""
    if degrees_of_freedom == inf:
        return t
    from scipy import stats  # loads slowly, and few readings are judged with so few repeats

    tail = float(stats.t.logsf(abs(t), degrees_of_freedom))
    # The tail as a logarithm, since it underflows where only its size matters.
    return copysign(_normal_deviate(tail), t)


def _normal_deviate(log_tail: float) -> float:
    """Solve ``log(1 - Phi(z)) = log_tail`` for z."""
    from scipy import special
    from scipy.optimize import brentq

    return float(brentq(lambda z: special.log_ndtr(-z) - log_tail, -1.0, 1e3))
