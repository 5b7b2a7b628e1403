"""Appendix A: the bouncing sphere as one mass on a spring, a dashpot and a yield depth."""

from labpipe.contact.lumped._collision import collision, contact_stiffness

__all__ = ["collision", "contact_stiffness"]
