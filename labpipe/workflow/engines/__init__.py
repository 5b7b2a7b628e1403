"""One way to run calls side by side: in this process, in local processes, on a Dask cluster.

An :class:`Engine` hires a :class:`Crew`; a crew is given one :class:`Call` after the other, a
function by its name with its arguments, and tells how each ended. :func:`side_by_side` does that
for calls that do not wait for each other. Who computes makes no difference to an answer: a worker
runs the numerical libraries on one thread, what kills a worker is tried again, and at the end of a
crew, by an interrupt too, its local processes have ended.
"""

from labpipe.workflow.engines._calls import (
    Call as Call,
    Crew as Crew,
    Died as Died,
    Engine as Engine,
    Serial as Serial,
    side_by_side as side_by_side,
)
from labpipe.workflow.engines._dask import Dask as Dask
from labpipe.workflow.engines._processes import (
    Processes as Processes,
    alongside as alongside,
    elsewhere as elsewhere,
    load_ahead as load_ahead,
    processors as processors,
)


def choose(jobs: int, cluster: str | None = None) -> Engine:
    """Return the engine that options of a command ask for.

    Parameters
    ----------
    jobs : int
        Local processes; 0 computes in this process.
    cluster : str, optional
        Address of a Dask scheduler, which takes the place of local processes.

    Examples
    --------
    >>> choose(2), choose(0), choose(1, "tcp://head:8786")
    (Processes(workers=2), Serial(), Dask(address='tcp://head:8786'))
    """
    if cluster is not None:
        return Dask(cluster)
    return Processes(jobs) if jobs else Serial()
