"""What session.toml may say: one module per kind of experiment, every default with its reason.

Nothing numerical is imported here, so that a session can be checked and planned at once.
"""
