"""Appendix A: the bouncing sphere as one mass on a spring, a dashpot and a yield depth."""

from labpipe.contact.lumped._collision import collision as collision, contact_stiffness as contact_stiffness
