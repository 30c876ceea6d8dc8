"""Tasks on a Ray cluster: they wait for those that they need, and end in any order."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from plat.collectors.cluster import Cluster
from plat.errors import PlatError, WorkerError

__all__ = ["RayTask", "run_tasks"]


@dataclass(frozen=True)
class RayTask:
    """Task on a Ray cluster.

    Attributes:
        name: what it is called.
        work: runs in a process of its own, on any machine; cloudpickle takes it there. It may be run again from the
            start when its process or machine is lost.
        needs: names of tasks that end before it begins.
        cpus: that it is given.
        gpus: that it is given.
    """

    name: str
    work: Callable[[], Any]
    needs: tuple[str, ...] = ()
    cpus: int = 1
    gpus: float = 0.0


def run_tasks(tasks: Sequence[RayTask], cluster: Cluster) -> Iterator[tuple[RayTask, PlatError | None]]:
    """Yield each task as it ends, with the error that it ended in, if any. The others go on.

    Args:
        tasks: those that are needed stand before those that need them.
        cluster: where they run.

    Raises:
        WorkerError: for a task that no machine of the cluster has the CPUs or GPUs for.
    """
    ray: Any = cluster.ray
    for task in tasks:
        _check_room(task, cluster.machines())
    # a process of its own each: what trainings leave in memory is not for the next
    run = ray.remote(max_calls=1)(_run)
    references: dict[str, Any] = {}
    for task in tasks:
        options = run.options(num_cpus=task.cpus, num_gpus=task.gpus, name=task.name)
        references[task.name] = options.remote(task.work, *(references[name] for name in task.needs))
    waiting = {references[task.name]: task for task in tasks}
    failed: set[str] = set()
    while waiting:
        (ended, *_), _ = ray.wait(list(waiting))
        task = waiting.pop(ended)
        error = None
        try:
            ray.get(ended)
        except ray.exceptions.RayError as raised:
            failed.add(task.name)
            error = _error(task, raised, failed)
        yield task, error


def _run(work: Callable[[], Any], *needed: Any) -> None:
    """Run a task, on the cluster, after those that it needs."""
    work()


def _check_room(task: RayTask, machines: Sequence[dict[str, Any]]) -> None:
    resources = [machine["Resources"] for machine in machines]
    if not any(have.get("CPU", 0) >= task.cpus and have.get("GPU", 0) >= task.gpus for have in resources):
        wanted = f"{task.cpus} CPUs" + f" and {task.gpus:g} GPUs" * bool(task.gpus)
        raise WorkerError(f"{task.name}: no machine of the cluster has {wanted}")


def _error(task: RayTask, raised: Exception, failed: set[str]) -> PlatError:
    needed = [name for name in task.needs if name in failed]
    if needed:
        return WorkerError(f"needs {needed[0]!r}, which failed")
    cause = getattr(raised, "cause", None)
    if isinstance(cause, PlatError):
        return cause
    reason = f"{type(cause).__name__}: {cause}" if cause is not None else str(raised)
    return WorkerError((reason.splitlines() or [type(raised).__name__])[0])
