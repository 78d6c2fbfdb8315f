"""Work on numbered units on an existing Dask cluster (extra `[cluster]`).

The scheduler hands a unit to another worker where one has died. Results come to this process, which alone writes.
"""

from collections.abc import Callable, Generator, Sequence
from typing import Any, TypeVar

from scleraforce.errors import InputError, SolverError

__all__ = ["work_on_cluster"]

Result = TypeVar("Result")

CONNECT_S = 10.0


def work_on_cluster(
    work: Callable[[int], Result], units: Sequence[int], scheduler: str
) -> Generator[tuple[int, Result], None, None]:
    """Do units on the workers of a Dask scheduler; yield (unit, result) as they are done.

    Args:
        work: does a unit; it is pickled, and its modules are installed on the workers.
        units: numbers of the units.
        scheduler: address, like tcp://127.0.0.1:8786.

    Raises:
        InputError: no Dask here, or no scheduler there.
        SolverError: a unit killed one worker after the other.
        ScleraforceError: what a unit raised.
    """
    with _connect(scheduler) as client:
        import distributed

        done: Any = distributed.as_completed  # not annotated there
        futures = {client.submit(work, unit, pure=False): unit for unit in units}
        try:
            for future in done(futures, loop=client.loop):
                yield futures[future], future.result()
                future.release()
        except distributed.KilledWorker as fault:
            raise SolverError(f"{scheduler}: its workers die one after the other ({fault}); see their logs") from fault
        finally:
            client.cancel(list(futures))


def _connect(scheduler: str) -> Any:
    try:
        import distributed
    except ImportError as fault:
        raise InputError("--scheduler: Dask is not installed; run pip install 'scleraforce[cluster]'") from fault
    client: Any = distributed.Client  # not annotated there
    try:
        return client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as fault:
        raise InputError(f"--scheduler: no Dask scheduler answers at {scheduler} ({fault})") from fault
