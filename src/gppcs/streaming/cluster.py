"""Work on several processes or machines by Dask: tasks, their results, and whom they may be given to."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from gppcs.engine.extras import require_distributed
from gppcs.errors import ClusterError, ParameterError, shown

TIMEOUT = "10s"  # For the scheduler to answer, and for the first worker to be there.


class Cluster:
    """The workers of a Dask cluster.

    A task that is lost with its worker is done again by another. All tasks can be done twice.

    Parameters
    ----------
    client : distributed.Client

    Attributes
    ----------
    client : distributed.Client

    Raises
    ------
    ClusterError
        If there are no workers, or their version of gppcs is another.
    MissingExtraError
        If distributed is not installed.
    ParameterError
        If it is no client.
    """

    def __init__(self, client: Any) -> None:
        self._distributed = require_distributed()
        if not isinstance(client, self._distributed.Client):
            raise ParameterError(f"expected a distributed.Client, found {shown(client)}")
        self.client = client
        _check_versions(client)

    def each(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        """Apply a function to each item, in a task each.

        Parameters
        ----------
        function : callable
            Of this package, or a partial of one.
        items : sequence

        Yields
        ------
        object
            The results, in the order of the items.

        Raises
        ------
        ClusterError
            If the workers end again and again.
        Exception
            What the function raises.
        """
        shared = self._shared(function)
        futures = [self.client.submit(_done, shared, pickle.dumps(item), pure=False) for item in items]
        with self._watched(futures):
            for number in range(len(futures)):
                yield futures[number].result()
                futures[number] = None  # so that the workers forget it

    def merged(
        self,
        find: Callable[[Any], Any],
        items: Sequence[Any],
        merge: Callable[[Any, Any], Any],
        advanced: Callable[[], None],
    ) -> Any:
        """Apply a function to each item, and merge the results two by two on the workers.

        Parameters
        ----------
        find : callable
            As the function of `each`.
        items : sequence
            At least one.
        merge : callable
            Merges two neighbouring results.
        advanced : callable
            Called for each item, in order, when it is done.

        Returns
        -------
        object
            The one result that is left. It alone leaves the workers.
        """
        finding, merging = self._shared(find), self._shared(merge)
        first = [self.client.submit(_done, finding, pickle.dumps(item), pure=False) for item in items]
        level = list(first)
        while len(level) > 1:
            pairs = zip(level[::2], level[1::2], strict=False)
            after = [self.client.submit(_merged, merging, one, other, pure=False) for one, other in pairs]
            level = after + level[len(level) & ~1 :]
        with self._watched(level):
            for number in range(len(first)):
                self._distributed.wait(first[number])
                first[number] = None
                advanced()
            return level[0].result()

    def _shared(self, function: Callable[..., Any]) -> Any:
        """Return a future of a function. It is sent once; if its worker ends, the scheduler still knows it."""
        return self.client.submit(pickle.loads, pickle.dumps(function), pure=False)

    @contextmanager
    def _watched(self, futures: list[Any]) -> Iterator[None]:
        try:
            yield
        except self._distributed.KilledWorker as error:
            raise ClusterError(
                f"the workers ended again and again during a task ({error}); give each more memory, or fewer threads"
            ) from error
        except (self._distributed.comm.CommClosedError, self._distributed.client.FutureCancelledError) as error:
            raise ClusterError(f"the scheduler cannot be reached any more: {error}") from error
        finally:
            self.client.cancel([future for future in futures if future is not None])


@contextmanager
def local_cluster(workers: int) -> Iterator[Cluster]:
    """Start worker processes on this machine, and end them with the block.

    Parameters
    ----------
    workers : int

    Yields
    ------
    Cluster
    """
    distributed = require_distributed()
    with (
        distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address=":0", silence_logs="ERROR"
        ) as started,
        distributed.Client(started) as client,
    ):
        yield Cluster(client)


@contextmanager
def scheduler_at(address: str) -> Iterator[Cluster]:
    """Connect to a scheduler.

    Parameters
    ----------
    address : str
        Such as "tcp://10.0.0.5:8786".

    Yields
    ------
    Cluster

    Raises
    ------
    ClusterError
        If it does not answer.
    """
    distributed = require_distributed()
    try:
        client = distributed.Client(address, timeout=TIMEOUT)
    except (OSError, ValueError, TimeoutError) as error:
        raise ClusterError(
            f"expected a Dask scheduler at {address}, found none that answers within {TIMEOUT}; "
            "start one by `dask scheduler`, or check the address"
        ) from error
    with client:
        yield Cluster(client)


def _check_versions(client: Any) -> None:
    """Check that there are workers, and that all have this version of gppcs."""

    def version() -> str | None:  # a function in a function is sent as code, so it also runs where there is no gppcs
        from importlib import import_module, util

        return import_module("gppcs").__version__ if util.find_spec("gppcs") else None

    try:
        client.wait_for_workers(1, timeout=TIMEOUT)
    except TimeoutError as error:
        raise ClusterError(
            f"expected at least one worker, found none within {TIMEOUT}; start some by `dask worker ADDRESS`"
        ) from error
    own = version()
    others = {address: found for address, found in sorted(client.run(version).items()) if found != own}
    if others:
        named = ", ".join(f"gppcs {found or 'not at all'} at {address}" for address, found in others.items())
        raise ClusterError(f"expected gppcs {own} at all workers, found {named}; install that version there")


def _done(function: Callable[[Any], Any], item: bytes) -> Any:
    """Do a task on a worker. Its other threads do other tasks, so each has one thread."""
    from gppcs.engine.threads import set_threads

    set_threads(1)
    return function(pickle.loads(item))


def _merged(merge: Callable[[Any, Any], Any], one: Any, other: Any) -> Any:
    return merge(one, other)
