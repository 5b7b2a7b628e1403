"""The commands of the command line, one module per group; each is imported when it is called.

Beyond the usual commands on a session, the module holds the simulator's own options and estimates (adhesion, heating),
the recording of a controller, and the options of readers for values that a raw file lacks.
"""
