"""Viscoelastic contact: indentation and impact.

The room holds two integrators of an impact. Contacts up to a lift-off are collocated, which reaches 1e-7 in the time of
1e-4 and does batches of bounces. Rings, contacts that grow again, rest and static loads are stepped: 1e-7 would then
take fifty times as long, and late bounces on a light plate lose digits.
"""

from typing import TYPE_CHECKING

from labpipe.installation import lazily

if TYPE_CHECKING:
    from labpipe.contact._adhesion import (
        AdhesionEstimate as AdhesionEstimate,
        adhesion_in_impact as adhesion_in_impact,
        adhesive_states as adhesive_states,
    )
    from labpipe.contact._collision import collision as collision, contact_stiffness as contact_stiffness
    from labpipe.contact._heating import NOTICEABLE as NOTICEABLE, self_heating as self_heating
    from labpipe.contact.impact import Plate as Plate, drop as drop, impacts as impacts
    from labpipe.contact.line import (
        dissipated_power as dissipated_power,
        dissipated_work as dissipated_work,
        dynamic_stiffness as dynamic_stiffness,
        indent as indent,
        tapping_amplitude as tapping_amplitude,
    )
    from labpipe.contact.sphere import (
        CounterBody as CounterBody,
        counter_body as counter_body,
        load_sphere as load_sphere,
        press_sphere as press_sphere,
    )
else:
    __getattr__ = lazily(__name__)
