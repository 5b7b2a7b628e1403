"""Checks of what the session states of a specimen: Poisson's ratio, the scale of its moduli, its mode of loading."""

from dataclasses import replace
from math import log, log10

from labpipe.judging import Check, bounded, in_words, not_made, stated
from labpipe.materials import loading_of
from pipelines.experiments.dma._checked_sweeps import Export
from pipelines.experiments.dma.settings import Dma

_NU = 0.2  # lowest Poisson's ratio of a polymer that is no foam
_OFF_SCALE = 2.0  # factor by which no specimen's dimensions are in doubt


def poisson_ratio(settings: Dma) -> Check:
    nu = settings.nu
    message = f"nu = {nu.value:g}, polymers have {_NU} to 0.5"
    name = "Poisson's ratio"
    found = bounded(name, message, nu.value, max(nu.u, 1e-3), at_least=_NU, is_law=False, setting="nu")
    if found.level and 0.25 <= 10 * nu.value <= 0.5:
        return replace(found, cause=f"nu is probably {10 * nu.value:g}, not {nu.value:g}: its decimal point slipped")
    return found


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
