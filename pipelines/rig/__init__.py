"""The virtual rig: synthetic recordings with known true values."""
