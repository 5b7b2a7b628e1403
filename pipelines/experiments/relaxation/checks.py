"""Whether relaxation tests can be believed: commands, columns, cell, punch, and how they compare."""

from collections.abc import Sequence
from math import exp, hypot, log

import numpy as np
import xarray as xr

from labpipe.errors import InputError
from labpipe.judging import DOUBTFUL, Cause, Check, Level, in_words, judge, not_made, too_large
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.relaxation.comparison import rows
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import judgements, mach1_checks
from pipelines.experiments.shared.comparison_rows import FORCE_SCALE, STIFFNESS
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene
from pipelines.experiments.shared.mach1_checks import RATIO
from pipelines.experiments.shared.punch_model import inputs_of
from pipelines.experiments.shared.ramps_and_holds import Hold, find, mean_force, relative_gain

_SHARES = (0.3, 0.9)  # of the shortest hold, between which relaxations are held against each other
_NON_LINEAR = 0.03  # by which late over early force may differ from depth to depth
_OF_DEPTHS = log(1.5)
"""By which forces over those of the model may differ from depth to depth: layers, rough tips, a touch found late."""
_FAILED = {
    "loads": "the file, or the record of its load cell, does not belong to this test",
    "ramps": "the stage was not moved and held, or its column is wrong",
    "curves": "the position of first touch, or the punch in session.toml, is wrong",
    "model": "the position of first touch, or the punch in session.toml, is wrong",
}


_STEPS = ("readings", "loads", "ramps", "comparison", "tests")


@judgements.judging(
    *_STEPS, rests_on=("substrate.material_from",), expected=("comparison", "tests"), titles=mach1_checks.TITLES
)
def judgement(given: Given, basis: judgements.Basis, settings: Relaxation, context: Context) -> Scene:
    """Judge all relaxation tests of an experiment; what gave no result is judged by that."""
    readings, loads, ramps, comparison, tests = map(given.get, _STEPS)
    files = settings.mach1
    checks: list[Check] = []
    relative = 0.0
    ratios: list[tuple[str, float]] = []
    for number, name in enumerate(files):
        read, load, ramp, compared = (_at(r, number) for r in (readings, loads, ramps, comparison))
        found = _of_file(name, read, load, ramp, compared)
        causes: list[Cause] = []
        if read is not None and any(check.level for check in found):
            causes = list(mach1_checks.causes(name, read, settings.punch, settings.load_cell, found))
        ratios += [(name, check.log_ratio) for check in found if check.name == RATIO and np.isfinite(check.log_ratio)]
        # what is wrong with one file does not show in the others
        checks += judge(mach1_checks.weighed(found), causes).checks
        relative = relative if load is None else relative_gain(load)
    checks.append(mach1_checks.of_files({n: d for n, d in zip(files, readings or (), strict=False) if d is not None}))
    known = next((d for d in loads or () if d is not None), None)
    if known is not None:
        checks += mach1_checks.of_cell(settings.load_cell, known)
    if not any(check.level == "impossible" for check in checks):
        checks += [_alike(files, loads or ()), _one_specimen(ratios)]
    if mach1_checks.knows_depth(checks):
        deepest = _deepest(ramps)
        checks += mach1_checks.of_punch(settings.punch, settings.model, deepest)
    checks += mach1_checks.placed(judgements.failed_steps(context, _FAILED), *files, settings.load_cell.record)
    inputs = {FORCE_SCALE: Quantity(1.0, relative, "1"), STIFFNESS: Quantity(1.0, 0.0, "1")} | inputs_of(tests)
    return Scene(checks, (), given.each([rows]), inputs, basis=basis)


def _alike(files: Sequence[str], loads: Sequence[xr.Dataset | None]) -> Check:
    """Hold the relaxation of the files against each other, over times that all of them have."""
    name = "relaxation at other depths"
    found = [(f, load, _hold(load)) for f, load in zip(files, loads, strict=False) if load is not None]
    known = [(f, load, hold) for f, load, hold in found if hold is not None]
    if len(known) < 2:
        return not_made(name, "holds of two files")
    lasts = min(hold.last - hold.end for _, _, hold in known)
    logs, own = [], []
    for _, load, hold in known:
        windows = ((share * lasts, 0.1 * lasts) for share in _SHARES)
        levels = [mean_force(load, hold, hold.end + at - width, hold.end + at + width) for at, width in windows]
        if not all(level.force > 0.0 for level in levels):
            return not_made(name, "forces in compression")
        early, late = levels
        tare = float(np.nan_to_num(load["u_tare"])) * abs(1 / late.force - 1 / early.force)
        logs.append(log(late.force / early.force))
        own.append(hypot(tare, hypot(late.u / late.force, early.u / early.force)))
    centre = float(np.median(logs)) if len(logs) > 2 else 0.5 * (logs[0] + logs[1])
    worst = int(np.argmax(np.abs(np.array(logs) - centre)))
    others = [i for i in range(len(logs)) if i != worst]
    gap, centre = logs[worst] - float(np.mean([logs[i] for i in others])), float(np.mean([logs[i] for i in others]))
    u = hypot(own[worst], hypot(*(own[i] for i in others)) / len(others))
    file = known[worst][0]
    times = " to ".join(f"{share * lasts:.3g}" for share in _SHARES)
    text = (
        f"{file}: from {times} s of its hold the force changes by {100 * np.expm1(logs[worst]):+.1f} %, in the others "
        f"by {100 * np.expm1(centre):+.1f} %"
    )
    level: Level | None = "doubtful" if abs(gap) > max(DOUBTFUL * u, _NON_LINEAR) else None
    cause = (
        "the cell drifted, the stage crept on or the specimen moved in the hold of one of them; or the solid is not "
        "linear at these depths"
    )
    return Check(name, text, level, gap / u, cause=cause, file=file)


def _one_specimen(ratios: Sequence[tuple[str, float]]) -> Check:
    """Hold the forces of the files, each over that of the model at its depth, against each other."""
    name = "force at other depths"
    if len(ratios) < 2:
        return not_made(name, "two files, and a model")
    logs = np.array([ratio for _, ratio in ratios])
    worst = int(np.argmax(np.abs(logs - np.median(logs))))
    others = float(np.mean(np.delete(logs, worst)))
    gap, file = float(logs[worst]) - others, ratios[worst][0]
    text = (
        f"{file}: {in_words(exp(logs[worst]))} times the simulated force, {in_words(exp(others))} times in the others"
    )
    level: Level | None = "impossible" if abs(gap) > log(3.0) else "doubtful" if abs(gap) > _OF_DEPTHS else None
    cause = (
        f"the forces of {file} are {too_large(exp(gap))}: its scale, the specimen, the punch or the position "
        "of first touch is another than in the other files"
    )
    if len(ratios) == 2 and level:
        cause = f"the scale, the specimen or the punch of {ratios[0][0]} and {ratios[1][0]} are not the same"
    return Check(name, text, level, gap / _OF_DEPTHS * DOUBTFUL, cause=cause, file=file)


def _hold(loads: xr.Dataset) -> Hold | None:
    """Return the last hold of a file; None where there is none."""
    try:
        return find(loads)[-1]
    except InputError:
        return None


def _at(results: Sequence[xr.Dataset | None] | None, number: int) -> xr.Dataset | None:
    return results[number] if results is not None and number < len(results) else None


def _of_file(
    name: str,
    readings: xr.Dataset | None,
    loads: xr.Dataset | None,
    ramps: xr.Dataset | None,
    comparison: xr.Dataset | None,
) -> list[Check]:
    if readings is None:
        return [not_made(mach1_checks.SWAPPED, "a file that can be read")]
    checks = mach1_checks.of_file(name, readings)
    if mach1_checks.is_swapped(checks):
        return checks
    if ramps is None or loads is None or not bool(loads.attrs["is_tared"]) or not mach1_checks.knows_depth(checks):
        return checks
    force = float(ramps["plateau_force"][-1])
    expected = np.nan
    if comparison is not None and "plateau_force_model" in comparison:
        expected = float(comparison["plateau_force_model"][-1])
    return [*checks, mach1_checks.of_force(name, force, expected)]


def _deepest(ramps: Sequence[xr.Dataset | None] | None) -> float:
    depths = [float(found["depth"].max()) for found in ramps or () if found is not None]
    return max((d for d in depths if np.isfinite(d)), default=np.nan)
