"""Checks of a record: two ways to the same quantity, or a quantity against a law."""

from dataclasses import KW_ONLY, dataclass
from math import hypot, inf, isfinite, log, nan
from statistics import NormalDist
from typing import Any, Literal, NamedTuple

Level = Literal["impossible", "doubtful", "note"]
"""Severity of a finding."""
WEIGHT: dict[Level | None, int] = {None: 0, "note": 1, "doubtful": 2, "impossible": 3}

FLAGS = {"yes": 1, "unknown": 2, "doubtful": 3, "impossible": 4}
"""Verdicts as the primary flags of QARTOD, for exported netCDF (``flag_values``)."""

IMPOSSIBLE, DOUBTFUL, BROKEN = 10.0, 4.0, 5.0
"""Standard uncertainties beyond which two ways to one quantity contradict each other, beyond which they are doubtful
(once in 16,000 by chance), and by which a law without exceptions must be broken."""


def doubtful_among(count: int) -> float:
    """Return the standard uncertainties that the largest of ``count`` values exceeds as rarely as one exceeds 4."""
    normal = NormalDist()
    return -normal.inv_cdf(normal.cdf(-DOUBTFUL) / max(count, 1))


@dataclass(frozen=True, slots=True)
class Finding:
    """A fault of a record, its most likely cause, and where to look.

    ``message`` gives observation and expectation, with numbers; ``cause`` is the most likely mistake, empty when
    nothing singles one out. ``file`` is relative to the session, empty for session.toml. ``setting`` is a dotted name
    in it (``"sphere.radius"``; of session.toml below the experiment), from which ``line`` and ``value``, its text, are
    found when the finding is shown: lines move, names do not.
    """

    check: str
    level: Level
    message: str
    cause: str = ""
    file: str = ""
    line: int | None = None
    setting: str = ""
    value: str = ""

    @property
    def place(self) -> str:
        """File, line and text of the line, ``session.toml:17: height = "1.6 mm"``; empty if unknown."""
        where = self.file if self.line is None else f"{self.file}:{self.line}"
        return f"{where}: {self.value}" if self.value else where


@dataclass(frozen=True, slots=True)
class Check:
    """A check of one recording or of one stated value, with its result.

    ``name`` is the compared quantity, to which causes refer; ``message`` gives the observed and the expected value;
    ``level`` is None where nothing is wrong. ``margin`` is the difference in units of its standard uncertainty,
    ``log_ratio`` the natural logarithm of observed over expected, by which causes are distinguished; NaN where either
    has no meaning. ``needs`` is the statement or recording that is missing. ``cause``, ``file``, ``line`` and
    ``setting`` are as in :class:`Finding`, where the check itself knows them. ``title`` is the check that it belongs
    to, its name by default; ``recording`` was evaluated, empty for a value of the settings. ``otherwise`` is the cause
    where no other is found. ``is_generic`` is True where a processing step failed: a finding about the record itself
    explains it better.
    """

    name: str
    message: str
    level: Level | None = None
    margin: float = nan
    log_ratio: float = nan
    u_log_ratio: float = nan
    needs: str = ""
    cause: str = ""
    _: KW_ONLY
    file: str = ""
    line: int | None = None
    setting: str = ""
    title: str = ""
    recording: str = ""
    otherwise: str = ""
    is_generic: bool = False

    def __post_init__(self) -> None:
        if self.level is None:
            object.__setattr__(self, "cause", "")

    @property
    def is_made(self) -> bool:
        """Return whether everything that it needs was there."""
        return not self.needs


class CheckSummary(NamedTuple):
    """A check over all recordings, one row of a page: its name, its law in one sentence, and its results."""

    title: str
    law: str
    evaluations: tuple[Check, ...]

    @property
    def is_made(self) -> bool:
        """Return whether any evaluation was made, or one reports that it could not be."""
        return any(e.is_made for e in self.evaluations)

    @property
    def worst(self) -> Check:
        """The gravest evaluation; of those that are equally grave the one with the largest margin."""
        sizes = ((WEIGHT[e.level], e.is_made, abs(e.margin) if isfinite(e.margin) else 0) for e in self.evaluations)
        return max(zip(sizes, self.evaluations, strict=True), key=lambda pair: pair[0])[1]

    @property
    def summary(self) -> str:
        """Result over all recordings, ``"passed in 2 of 2 recordings, worst margin 1.2 u"``."""
        made = [e for e in self.evaluations if e.is_made]
        if not made:
            return self.worst.level or "not made"
        failed = [e for e in made if WEIGHT[e.level] > 1]
        text, noun, wrong, count = str(self.worst.level) if failed else "passed", "evaluations", len(failed), len(made)
        if places := {e.recording for e in made if e.recording}:
            noun, wrong, count = "recordings", len({e.recording for e in failed}), len(places)
        if count > 1:
            text += f" in {wrong if failed else count} of {count} {noun}"
        worst = max((abs(e.margin) for e in made if isfinite(e.margin)), default=nan)
        if worst >= 0.0:
            text += f", worst margin {worst:.1f} u"
        # a passed comparison may differ by more where a systematic effect is allowed for
        return text + " within the known systematic effects" * (worst > DOUBTFUL and not failed)


def compared(
    name: str,
    message: str,
    seen: float,
    u_seen: float,
    expected: float,
    u_expected: float,
    *,
    allowance: float = 0.0,
    factor: bool = True,
    **place: Any,
) -> Check:
    """Compare two ways to the same quantity: impossible beyond 10 u and the allowance, doubtful beyond 4 u.

    Parameters
    ----------
    name, message, **place
        See :class:`Check`.
    seen, u_seen, expected, u_expected : float
        In one unit; standard uncertainties without contributions that both share.
    allowance : float
        Largest systematic effect that the kind of experiment knows (such as drag), in the same unit.
    factor : bool
        Whether a wrong factor could explain a difference; then values of one sign are compared by their logarithms.
    """
    u = hypot(u_seen, u_expected)
    if not (isfinite(seen) and isfinite(expected) and isfinite(u) and u > 0.0):
        return not_made(name, "finite values with uncertainties")
    margin, ratio, u_ratio = (seen - expected) / u, nan, nan
    if factor and seen * expected > 0.0:
        ratio, u_ratio = log(seen / expected), hypot(u_seen / seen, hypot(u_expected, allowance / 2) / expected)
        margin = ratio / hypot(u_seen / seen, u_expected / expected)
    level: Level | None = None
    if abs(seen - expected) > allowance and abs(margin) > DOUBTFUL:
        level = "impossible" if abs(margin) > IMPOSSIBLE else "doubtful"
    return Check(name, message, level, margin, ratio, u_ratio, **place)


def bounded(
    name: str,
    message: str,
    value: float,
    u: float,
    *,
    at_least: float = -inf,
    at_most: float = inf,
    is_law: bool = True,
    **place: Any,
) -> Check:
    """Compare a quantity with a law without exception, such as 0 < e < 1.

    ``u`` is at least that of the noise, ``place`` as in :class:`Check`. With ``is_law=False`` the bounds are those of a
    plausible range: beyond it a value is doubtful, never impossible.
    """
    if not (isfinite(value) and isfinite(u)):
        return not_made(name, "a finite value with its uncertainty")
    beyond = max(at_least - value, value - at_most)
    margin = nan if beyond <= 0.0 else beyond / u if u else inf
    level: Level | None = "impossible" if is_law and margin > BROKEN else "doubtful" if margin > DOUBTFUL else None
    return Check(name, message, level, margin, **place)


def not_made(name: str, needs: str) -> Check:
    """Return a check that could not be made, with the statement or recording that it needs."""
    return Check(name, "", needs=needs)
