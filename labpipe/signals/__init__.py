"""Signals in time: derivative, events, oscillation, alignment, repeats, metrics."""

from typing import TYPE_CHECKING

from labpipe.installation import lazily

if TYPE_CHECKING:
    from labpipe.signals._alignment import combine_repeats as combine_repeats
    from labpipe.signals._as_fitted import as_fitted as as_fitted
    from labpipe.signals._bounces import PHASES as PHASES, bounces as bounces
    from labpipe.signals._derivative import velocity as velocity
    from labpipe.signals._first_touch import first_touch as first_touch
    from labpipe.signals._hum import MAINS as MAINS, Hum as Hum, hum_at_rest as hum_at_rest
    from labpipe.signals._hysteresis import (
        Window as Window,
        active_window as active_window,
        hysteresis_loops as hysteresis_loops,
    )
    from labpipe.signals._metrics import independent_count as independent_count, nrmse as nrmse
    from labpipe.signals._noise import (
        deviation as deviation,
        estimate_noise as estimate_noise,
        quantisation_step as quantisation_step,
    )
    from labpipe.signals._oscillation import (
        CommonFit as CommonFit,
        Oscillation as Oscillation,
        common_fit as common_fit,
        fit_sinusoid as fit_sinusoid,
    )
    from labpipe.signals._outliers import LONGEST_RUN as LONGEST_RUN, Outliers as Outliers, outliers as outliers
    from labpipe.signals._ringing import Ringing as Ringing, blows as blows, ringing as ringing
    from labpipe.signals._shape_prior import Floor as Floor
else:
    __getattr__ = lazily(__name__)
