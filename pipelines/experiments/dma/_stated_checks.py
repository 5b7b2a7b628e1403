"""Checks of what the session states of a specimen: Poisson's ratio, the scale of its moduli, its mode of loading."""

from collections.abc import Sequence
from dataclasses import replace
from math import log, log10

import numpy as np

from labpipe.judging import Check, bounded, in_words, not_made, stated
from labpipe.materials import loading_of, modulus_factor
from labpipe.report import quantity
from pipelines.experiments.dma._checked_sweeps import POLYMERS, Export
from pipelines.experiments.dma.settings import Dma

_NU = 0.2  # lowest Poisson's ratio of a polymer that is no foam
_BULK = 1e10  # Pa, above the bulk modulus of any polymer
_LEAST_BULK = 1e8  # Pa, below that of any polymer without pores
_NU_OF_RUBBER = 5e-3  # u of a rubber's Poisson's ratio, at least
_OFF_SCALE = 2.0  # factor by which no specimen's dimensions are in doubt


def poisson_ratio(settings: Dma) -> Check:
    nu = settings.nu
    message = f"nu = {nu.value:g}, polymers have {_NU} to 0.5"
    name = "Poisson's ratio"
    found = bounded(name, message, nu.value, max(nu.u, 1e-3), at_least=_NU, is_law=False, setting="nu")
    if found.level and 0.25 <= 10 * nu.value <= 0.5:
        return replace(found, cause=f"nu is probably {10 * nu.value:g}, not {nu.value:g}: its decimal point slipped")
    return found


def bulk_modulus(exports: Sequence[Export], settings: Dma) -> Check:
    """Hold Poisson's ratio against the modulus: a glass as incompressible as a rubber would be stiffer than metal."""
    name = "bulk modulus"
    sizes = [float(np.median(e.values("storage_modulus"))) for e in exports]
    if not sizes or not min(sizes) > 0:
        return not_made(name, "moduli")
    nu = settings.nu
    E, stiffest = (f(sizes) * modulus_factor(settings.mode, nu.value) * settings.scale.value for f in (min, max))
    most = 0.5 - E / (6 * _BULK)
    message = f"nu = {nu.value:g} at a modulus of {quantity(E, 'Pa')}, where polymers have {max(most, _NU):.3g} at most"
    found = bounded(name, message, nu.value, max(nu.u, 1e-3), at_most=max(most, _NU), is_law=False, setting="nu")
    if found.level:
        return replace(found, cause="nu is that of a rubber, or the unit of the moduli is wrong")
    least = 0.5 - stiffest / (6 * _LEAST_BULK)
    if nu.value >= least or POLYMERS[0] > stiffest:  # softer than any polymer: the unit is wrong, as its own check says
        return found
    message = f"nu = {nu.value:g} at a modulus of {quantity(stiffest, 'Pa')}, where polymers have {least:.3g} at least"
    u = max(nu.u, _NU_OF_RUBBER)
    found = bounded(name, message, nu.value, u, at_least=least, is_law=False, setting="nu")
    return replace(found, cause="nu is that of a glass, or the unit of the moduli is wrong")


def scale_of_moduli(settings: Dma) -> Check:
    name = "scale of the moduli"
    scale = settings.scale.value
    is_far = abs(log(scale)) > log(_OFF_SCALE)
    cause = ""
    if is_far and abs(log10(scale) - round(log10(scale))) > 0.02:
        cause = "scale is mistyped: it corrects the specimen's dimensions alone"
    elif is_far:
        cause = "scale is probably 1: its decimal point slipped, or it was taken for a unit"
    text = f"all moduli are multiplied by {scale:g}"
    return stated(name, text, "doubtful" if is_far else None, cause=cause, setting="scale")


def mode_of_loading(export: Export, settings: Dma) -> Check:
    """Hold the mode against the headings of strain and moduli, where one of them tells."""
    name = "mode of loading"
    seen, heading = loading_of(export.data)
    if not seen:
        return not_made(name, "a heading that says shear or extensional strain, or whether a modulus is G or E")
    is_shear = seen == "shear"
    expects_shear = settings.mode in ("shear", "torsion")
    message = f'{export.name} has a column "{heading}", session.toml says mode = "{settings.mode}"'
    should = "torsion or shear" if is_shear else "tension or bending"
    factor = 2 * (1 + settings.nu.value)
    cause = f"mode is probably {should}, not {settings.mode}: moduli are a factor {in_words(factor)} off"
    return stated(name, message, "doubtful" if is_shear != expects_shear else None, cause=cause, setting="mode")
