"""Signals in time: derivative, events, oscillation, alignment, repeats, metrics."""

from labpipe.signals._align import Lag, interpolated_at, lag, timed_from_event
from labpipe.signals._as_fitted import as_fitted
from labpipe.signals._cycles import Window, active_window, hysteresis_loops
from labpipe.signals._derivative import velocity
from labpipe.signals._events import PHASES, bounces, phases
from labpipe.signals._first_touch import FirstTouch, first_touch
from labpipe.signals._floor import Floor
from labpipe.signals._mains import MAINS, Hum, hum_at_rest
from labpipe.signals._metrics import Agreement, agreement, compare, independent_count, nrmse
from labpipe.signals._noise import estimate_noise, quantisation_step
from labpipe.signals._oscillation import CommonFit, Sinusoid, common_fit, fit_sinusoid
from labpipe.signals._repeats import combine_repeats
from labpipe.signals._ringing import Ringing, ringing
from labpipe.signals._vibration import Damped, damped_oscillation

__all__ = [
    "MAINS",
    "PHASES",
    "Agreement",
    "CommonFit",
    "Damped",
    "FirstTouch",
    "Floor",
    "Hum",
    "Lag",
    "Ringing",
    "Sinusoid",
    "Window",
    "active_window",
    "agreement",
    "as_fitted",
    "bounces",
    "combine_repeats",
    "common_fit",
    "compare",
    "damped_oscillation",
    "estimate_noise",
    "first_touch",
    "fit_sinusoid",
    "hum_at_rest",
    "hysteresis_loops",
    "independent_count",
    "interpolated_at",
    "lag",
    "nrmse",
    "phases",
    "quantisation_step",
    "ringing",
    "timed_from_event",
    "velocity",
]
