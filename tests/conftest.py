"""Settings of all tests."""

import signal

from hypothesis import HealthCheck, settings

# Tests hold results, never seconds: a busy machine must not fail them. The same examples at every
# run, so that a failure belongs to the change that caused it; `--hypothesis-profile=explore` looks
# further.
settings.register_profile(
    "steady", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile(
    "explore", deadline=None, max_examples=1000, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("steady")

# Tests that run in the background inherit ignored signals, and would hand them down to the programs
# that they interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP"):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
