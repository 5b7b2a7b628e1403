"""The experiments, the session, the thesis figures, the virtual rig, the command line."""
