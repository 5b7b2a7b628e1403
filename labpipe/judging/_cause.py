"""Mistakes that explain several checks at once.

Most mistakes of a laboratory are factors: a wrong unit, interval, gain or angle moves several redundant quantities by
known powers of one factor. That factor is fitted to the logarithms of all checks, and causes are ranked by the chi
square that they leave.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from math import exp, hypot, inf, isfinite, log, pi, sqrt
from typing import NamedTuple

import numpy as np

from labpipe.judging._check import IMPOSSIBLE, Check

_FLOOR = 2e-3  # least relative uncertainty of a check when causes are compared: the laws are that good
_USUAL = 9.0  # gain in chi square of a factor that people are known to get wrong (1000, 25.4, 2) over any other
_RIGHT = 2.0  # standard uncertainties by which a check is off that is right
_ALIKE = _RIGHT * _RIGHT  # difference in chi square up to which two causes cannot be distinguished
_EXPLAINED = 0.1  # part of chi square that a cause may leave, where that is more, and still be named
_SMALL = 1.1  # factor below which per cent say more

SLIPS = {
    of: (*factors, *(1.0 / k for k in factors))
    for of, factors in {
        "value": (2.0, 10.0, 100.0, 1e3, 25.4, 2 * pi),
        "size": (2.0, 10.0, 100.0, 1e3, 25.4),
        "decimal": (2.0, 10.0),
        "length": (10.0, 100.0, 1e3, 1e4, 1e6, 25.4, 1e3 / 25.4),
        "gain": (2.0,),
        "interval": (2.0, 2.5, 4.0, 5.0, 10.0, 100.0, 1e3),
        "mass": (10.0, 100.0, 1e3, 9.81, 2.2046),
        "view": (36.0,),
    }.items()
}
"""Factors, and their inverses, by which people state something wrongly.

A value: diameter for radius, decimals, units, a period for an angle, which no size is. A mass: its weight, decimals,
units, pounds. An interval or a rate: the next settings of a controller. A view: another lens.
"""


@dataclass(frozen=True, slots=True)
class Cause:
    """A mistake that multiplies an input by a factor.

    ``effects`` are the powers of the factor by which checks (seen over expected) move; ``say`` takes the factor and
    returns the sentence, such as ``"the sampling cycle is probably 100 µs, not 50 µs"``. ``usual`` are factors that the
    mistake usually has, empty when any is as likely, from which a factor that is found may differ by ``slack``
    (relative; other inputs may be off too); with ``only_usual`` no other factor is this mistake. ``u`` is the relative
    standard uncertainty of the input, the usual one where none ``is_stated``: a factor of more than ten of them comes
    after every other cause. ``file``, ``line`` and ``setting`` are the place, see :class:`Finding`.
    """

    effects: Mapping[str, float]
    say: Callable[[float], str]
    usual: tuple[float, ...] = ()
    only_usual: bool = False
    slack: float = 0.02
    _: KW_ONLY
    u: float = inf
    is_stated: bool = True
    file: str = ""
    line: int | None = None
    setting: str = ""


class Explanation(NamedTuple):
    """A cause, the factor by which its input is too large, and the checks that it moves.

    ``score``: minus twice the log-likelihood, less for a usual factor; ``n_u``: error in stated u, 0 for a usual one.
    """

    cause: Cause
    factor: float
    checks: tuple[str, ...]
    score: float
    n_u: float

    @property
    def is_last_resort(self) -> bool:
        """Return whether it needs an error that the stated uncertainty excludes."""
        return self.n_u > IMPOSSIBLE

    @property
    def sentence(self) -> str:
        """The probable mistake."""
        far = f", off by {in_words(self.n_u, 2)} times its {'stated' if self.cause.is_stated else 'usual'} uncertainty"
        return self.cause.say(self.factor) + far * self.is_last_resort


def explain(checks: Sequence[Check], causes: Sequence[Cause]) -> tuple[Explanation, ...]:
    """Rank the causes that explain nine tenths of the checks' chi square, the likeliest first.

    Checks that are right count as well: a cause that would move them is the less likely for it.
    """
    known = [c for c in checks if isfinite(c.log_ratio) and isfinite(c.u_log_ratio)]
    rows = [(c.name, c.log_ratio, hypot(c.u_log_ratio, _FLOOR)) for c in known]
    wrong, found = {c.name for c in checks if c.level}, []
    for cause in causes:
        if not any(cause.effects.get(name) for name in wrong):
            continue
        moved = [(cause.effects.get(name, 0.0), r, u) for name, r, u in rows]
        weight = sum((d / u) ** 2 for d, _, u in moved)
        if weight == 0.0:
            continue
        best = sum(d * r / u**2 for d, r, u in moved) / weight
        usual = min((log(k) for k in cause.usual), key=lambda place: abs(place - best), default=inf)
        # what can be no other factor is that one, as far as the checks tell
        is_usual = abs(usual - best) <= 2 * hypot(cause.slack, cause.only_usual / sqrt(weight))
        if not is_usual and (cause.only_usual or abs(best) > log(1e3)):  # farther off are units alone
            continue
        place = usual if is_usual else best
        # held against the same uncertainties, or a usual factor would explain by its slack alone
        held = [(d, r, hypot(u, d * cause.slack) if is_usual else u) for d, r, u in moved]
        before = sum((r / u) ** 2 for _, r, u in held)
        rest = [(d, (r - d * place) / u) for d, r, u in held]
        left = sum(z**2 for _, z in rest)
        # a check that it does not move, and that is right, speaks neither for it nor against it
        if sum(z**2 for d, z in rest if d or abs(z) > _RIGHT) <= max(_EXPLAINED * before, _ALIKE):
            names, n_u = tuple(n for n, *_ in rows if cause.effects.get(n)), 0.0 if is_usual else abs(place) / cause.u
            found.append(Explanation(cause, exp(place), names, left - _USUAL * is_usual, n_u))
    # of errors beyond every uncertainty that explain as much the smallest is first
    alike = min((one.score for one in found if one.is_last_resort), default=0.0) + _ALIKE
    scores = [(last := one.is_last_resort, max(one.score, alike) if last else one.score, one.n_u) for one in found]
    return tuple(found[i] for i in sorted(range(len(found)), key=scores.__getitem__))


def with_causes(checks: Sequence[Check], ranked: Sequence[Explanation]) -> list[Check]:
    """Return checks, those that fail and have no cause of their own with the likeliest of :func:`explain`.

    Causes that explain as much are all given, with file, line and setting of the first.
    """
    told = list(checks)
    for i, check in enumerate(checks):
        known = [one for one in ranked if check.name in one.checks]
        if check.level and known and not check.cause:
            best = known[0]
            alike = [o for o in known if o.score <= best.score + _ALIKE and o.is_last_resort == best.is_last_resort]
            place = best.cause if best.cause.file or best.cause.setting else check
            said = "; or ".join(dict.fromkeys(one.sentence for one in alike))
            told[i] = replace(check, cause=said, file=place.file, line=place.line, setting=place.setting)
    return told


def too_large(factor: float) -> str:
    """Say by how much something is too large or too small: '1000 times too large', '0.04 % too small'."""
    if 1 / _SMALL < factor < _SMALL:
        return f"{in_words(100.0 * abs(factor - 1.0), 2)} % too {'large' if factor >= 1.0 else 'small'}"
    times = in_words(max(factor, 1.0 / factor), 4)
    return f"{times} times too large" if factor >= 1.0 else f"too small by a factor of {times}"


def in_words(factor: float, digits: int = 3) -> str:
    """Write a factor with so many digits and without an exponent: 1e6 as '1,000,000'."""
    rounded = float(f"{factor:.{digits}g}")
    return f"{rounded:,.0f}" if abs(rounded) >= 1e4 else np.format_float_positional(rounded, trim="-")
