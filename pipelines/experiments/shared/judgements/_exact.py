"""A model that differs only because values were stated without an uncertainty."""

from collections.abc import Mapping, Sequence

import numpy as np

from labpipe.arrays import Floats
from labpipe.judging import agreement, model_verdict
from labpipe.report import quantity
from labpipe.units import Quantity
from pipelines.experiments.shared.exact_values import usual_uncertainty
from pipelines.experiments.shared.judgements._words import of_error


def undecided_by(
    names: Sequence[str],
    inputs: Mapping[str, Quantity],
    slopes: Floats,
    differences: Sequence[float],
    covariance: Floats,
) -> str:
    """Say which values need an uncertainty, where usual ones would explain why a model differs.

    Parameters
    ----------
    names : sequence of str
        Inputs (m) that could have been stated wrongly.
    inputs : mapping of str to Quantity
    slopes : array (n, m)
        Derivatives of the differences, SI.
    differences : sequence of float
        Measured minus model (n).
    covariance : array (n, n)

    Returns
    -------
    str
        Empty where the model differs in spite of usual uncertainties.
    """
    usual = {
        i: usual_uncertainty(given)
        for i, name in enumerate(names)
        if not (given := inputs[name]).u and given.value and not (given.si == "1" and float(given.value).is_integer())
    }

    def differs(some: Sequence[int]) -> bool:
        effects = slopes[:, some] * [usual[i] for i in some]
        found = agreement(differences, covariance + effects @ effects.T)
        return model_verdict(found, could_notice=True) == "differs"

    if not usual or differs(list(usual)):
        return ""
    alone = [i for i in usual if not differs([i])]
    listed = alone or [i for i in usual if np.any(slopes[:, i])]
    shown = ", ".join(f"{names[i]} (± {quantity(usual[i], of_error(inputs[names[i]].si), 1)})" for i in listed)
    joined = "or" if alone and len(alone) > 1 else "and"
    words = f" {joined} ".join(names[i] for i in listed)
    return (
        f"state ± of {words}: counted as exact here; with half a unit of the last digit, {shown}, the model would not "
        "differ"
    )
