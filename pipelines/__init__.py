"""The experiments, the session, the thesis figures, the virtual rig, the benchmark, the command line."""
