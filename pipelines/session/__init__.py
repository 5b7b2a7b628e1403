"""The verbs on a session folder."""
