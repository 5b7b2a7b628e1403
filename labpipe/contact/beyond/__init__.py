"""Beyond the thesis: adhesion, self-heating, and moduli that depend on the amplitude of strain."""

from labpipe.contact.beyond._adhesion import (
    cohesive_stress as cohesive_stress,
    dmt as dmt,
    jkr as jkr,
    jkr_at_force as jkr_at_force,
    lost_energy as lost_energy,
    maugis as maugis,
    maugis_parameter as maugis_parameter,
    pull_off as pull_off,
    tabor as tabor,
)
from labpipe.contact.beyond._adhesion_estimate import (
    AdhesionEstimate as AdhesionEstimate,
    adhesion_in_impact as adhesion_in_impact,
)
from labpipe.contact.beyond._adhesive_mdr import (
    adhesive_indentation as adhesive_indentation,
    adhesive_pull_off as adhesive_pull_off,
)
from labpipe.contact.beyond._adhesive_states import adhesive_states as adhesive_states
from labpipe.contact.beyond._amplitude import amplitude_sweep as amplitude_sweep
from labpipe.contact.beyond._heating import (
    NOTICEABLE as NOTICEABLE,
    Heating as Heating,
    flash_temperature as flash_temperature,
    self_heating as self_heating,
)
