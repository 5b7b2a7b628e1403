"""Identification of a material from the experiments of a session, its result and its page."""
