"""Rollouts of robots that are simulated in worker processes: TorchRL's collectors, one for each worker."""

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Any, TypeVar

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase

from plat.bounds import Count, check_value
from plat.collectors.hosts import EnvFactory, Host, Processes, RemoteCollector
from plat.collectors.packing import as_bytes, as_tensor, packed
from plat.collectors.ray_actors import RayActors
from plat.collectors.rollouts import Rollouts
from plat.collectors.worker import Job, Order, Report, seed_of
from plat.entries import check_policy
from plat.envs.physics.transfer import to_device
from plat.errors import ConfigError, StateError, WorkerError
from plat.gpu import check_device
from plat.motions.library import MotionLibrary
from plat.precision import Precision
from plat.words import counted

__all__ = ["WorkerRollouts", "collect"]

T = TypeVar("T")

_ATTEMPTS = 3
"""Times that a rollout is tried before a worker that ends in it is given up."""


def collect(
    make_env: EnvFactory,
    library: MotionLibrary,
    num_envs: int,
    policy: TensorDictModuleBase,
    steps: int,
    precision: Precision = "auto",
    *,
    device: torch.device | str = "cpu",
    workers: int = 0,
    ahead: bool = False,
    ray: bool = False,
    host: Host | None = None,
) -> "Rollouts | WorkerRollouts":
    """Return rollouts ``[N, steps]`` without end, of robots in this process or in workers.

    Args:
        make_env: makes an environment of some of the robots.
        library: motions.
        num_envs: number of robots N, all together.
        policy, steps, precision: as for :func:`plat.collectors.rollouts`.
        device: of the rollouts.
        workers: processes; 0 for this one.
        ahead, ray, host: see :class:`WorkerRollouts`; without meaning in this process.

    Raises:
        ConfigError: for more workers than robots, or ``ray`` without workers.
        WorkerError: where there is no Ray, or workers cannot be kept running.
    """
    if ray and not workers:
        raise ConfigError("--ray: expected workers for the cluster, such as --workers 4")
    if workers:
        options: dict[str, Any] = {"device": device, "workers": workers, "ahead": ahead, "ray": ray, "host": host}
        return WorkerRollouts(make_env, library, num_envs, policy, steps, precision, **options)
    return Rollouts(make_env(library, num_envs, num_threads=None, device=device), policy, steps, precision)


class WorkerRollouts(Iterator[TensorDictBase]):
    """Iterator over rollouts ``[N, steps]`` without end, of robots that worker processes simulate.

    Each worker has a share of the robots and of the CPUs, and its own random stream. Workers map the motions from a
    file, so all share them. Every rollout is of one set of weights: those that the policy has when it begins. Rows are
    in the order of the workers, so a run is the same from one time to the next.

    A worker that ends, of whatever cause, is started again in the state before the rollout that it was in. So that
    rollout is the same as without the accident. A run's state holds that of all workers.

    One worker that does not simulate ahead draws from the caller's random stream, so its rollouts are those of
    :class:`Rollouts`, bit by bit.

    Args:
        make_env, library, num_envs, policy, steps, precision: as for :func:`collect`.
        device: of the rollouts. Workers compute on the CPU.
        workers: number of processes W, at most N.
        ahead: the workers simulate the next rollout while the caller learns from this one. Their weights are then one
            update old, which only off-policy learning allows, and leave a CPU to the caller.
        ray: workers run on a Ray cluster, see :class:`plat.collectors.ray_actors.RayActors`.
        host: where else they run; None for processes on this machine.

    Raises:
        ConfigError: for more workers than robots.
        WorkerError: when a worker ends again and again in the same rollout.
        PlatError: what an environment raises in a worker.
    """

    # TorchRL's collectors of many workers fail as a whole when one process ends, and processes that share a queue may
    # be blocked by one that was killed. Therefore each worker has a collector of its own here, and threads wait for
    # them. Weights go by map_fn: TorchRL's schemes write into shared memory while a rollout may be under way.

    def __init__(
        self,
        make_env: EnvFactory,
        library: MotionLibrary,
        num_envs: int,
        policy: TensorDictModuleBase,
        steps: int,
        precision: Precision = "auto",
        *,
        device: torch.device | str = "cpu",
        workers: int = 1,
        ahead: bool = False,
        ray: bool = False,
        host: Host | None = None,
    ):
        check_value("rollouts: steps", steps, Count)
        check_policy(policy, "rollouts")
        check_value("rollouts: workers", workers, Count)
        if workers > num_envs:
            raise ConfigError(
                f"rollouts: {counted(workers, 'worker')} for {counted(num_envs, 'robot')}, "
                "expected at most one for each"
            )
        self._policy = policy
        self._device = check_device(device)
        self._ahead = ahead
        self._in_step = workers == 1 and not ahead
        """Whether the one worker draws from the caller's random stream."""
        self._statistics: list[tuple[int, dict[str, float]]] = []
        self._host = host or (RayActors() if ray else Processes())
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="plat-worker")
        self._workers: list[_Worker | None] = [None] * workers
        self._pending: list[Future[tuple[TensorDictBase, Report]]] = []
        self._order: Order | None = None
        """What the rollout that is under way was begun with."""
        threads = torch.get_num_threads()
        try:
            content = self._host.share(library, make_env, copy.deepcopy(policy).to("cpu"), precision)
            sizes = [num_envs // workers + (number < num_envs % workers) for number in range(workers)]
            self._jobs = [
                Job(
                    content,
                    number=number,
                    num_envs=size,
                    steps=steps,
                    num_threads=self._host.threads(workers + ahead),
                    random=torch.get_rng_state() if self._in_step else seed_of(torch.initial_seed(), number),
                    errors=self._host.errors,
                )
                for number, size in enumerate(sizes)
            ]
            # the states from which the next rollouts begin; a worker that is not there yet begins afresh
            self._states: list[bytes | None] = [None] * workers
            reports = list(self._pool.map(self._first, range(workers)))
            self._states = [report.state for report in reports]
            if self._in_step:
                torch.set_rng_state(reports[0].random)
        except BaseException:
            self.close()
            raise
        finally:
            torch.set_num_threads(threads)  # TorchRL takes some away for its workers

    def _first(self, number: int) -> Report:
        return self._kept(number, lambda worker: worker.call("report"))

    def _running(self, number: int) -> "_Worker":
        """Return a worker, which is started in the state of its last rollout's end if it is not there."""
        worker = self._workers[number]
        if worker is None:
            worker = self._workers[number] = _Worker(self._host.launch(self._jobs[number]))
            if (state := self._states[number]) is not None:
                worker.call("resume", state)
        return worker

    def _turn(self, number: int, order: Order) -> tuple[TensorDictBase, Report]:
        """Return a worker's next rollout, and what it reports after it."""
        return self._kept(number, lambda worker: worker.turn(order))

    def _kept(self, number: int, ask: "Callable[[_Worker], T]") -> T:
        """Return a worker's answer; one that ends before it answers is started again."""
        for attempt in range(1, _ATTEMPTS + 1):
            try:
                return ask(self._running(number))
            except self._host.ended as error:
                cause = self._host.cause(self._jobs[number], error)
                self._end(number)
                if cause is not None:
                    raise cause from None
                reason = (str(error).splitlines() or [type(error).__name__])[0]
                if attempt == _ATTEMPTS:
                    raise WorkerError(
                        f"worker {number} of {len(self._jobs)} ended {_ATTEMPTS} times in the same rollout ({reason}); "
                        "what it printed before says why"
                    ) from error
                print(f"worker {number} ended ({reason}); it begins its rollout again", flush=True)
        raise AssertionError

    def _end(self, number: int) -> None:
        worker, self._workers[number] = self._workers[number], None
        if worker is not None:
            worker.close()

    def __next__(self) -> TensorDictBase:
        if not self._pending:
            self._send()
        pending, self._pending = self._pending, []
        results = [future.result() for future in pending]
        reports = [report for _, report in results]
        self._states = [report.state for report in reports]
        shares = [job.num_envs for job in self._jobs]
        self._statistics += [(share, report.statistics) for share, report in zip(shares, reports, strict=True)]
        if self._in_step:
            torch.set_rng_state(reports[0].random)
        if self._ahead:
            self._send()
        rollout = results[0][0] if len(results) == 1 else torch.cat([rollout for rollout, _ in results])
        return rollout if self._device.type == "cpu" else to_device(rollout, self._device)

    def _send(self) -> None:
        """Let all workers begin the next rollout, with the weights as they are."""
        weights = packed({name: value.detach().cpu() for name, value in self._policy.state_dict().items()})
        self._begin(Order(weights, torch.get_rng_state() if self._in_step else None))

    def _begin(self, order: Order) -> None:
        self._order = order
        self._pending = [self._pool.submit(self._turn, number, order) for number in range(len(self._jobs))]

    def statistics(self) -> dict[str, float]:
        """Return the means over all robots that were gathered since the last call; of counts the sum."""
        gathered, self._statistics = self._statistics, []
        return _merged(gathered)

    def state_dict(self) -> dict[str, Any]:
        """Return the state from which the next rollouts are the same.

        Of a rollout that is simulated ahead it holds the weights, so that it can be simulated once more.
        """
        state: dict[str, Any] = {"workers": [as_tensor(state) for state in self._states if state is not None]}
        if self._pending and self._order is not None:
            state["weights"] = as_tensor(self._order.weights)
        return state

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore a state of :meth:`state_dict`.

        Raises:
            StateError: when it is of another number of workers or robots.
        """
        states = state.get("workers", ())
        if "robots" in state and len(self._jobs) == 1:  # of robots that were simulated where they learned
            if not self._in_step:  # a stream that no earlier worker of the run had
                drawn = int(torch.randint(1 << 62, ()))
                state = {**state, "random": torch.Generator().manual_seed(drawn).get_state()}
            states = [as_tensor(packed(state))]
        if len(states) != len(self._jobs):
            raise StateError(
                f"rollouts: a state of {counted(len(states), 'worker') if states else 'no workers'}, "
                f"expected {len(self._jobs)}; go on with as many as before (--workers)"
            )
        for future in self._pending:
            future.result()
        self._pending = []
        self._states = [as_bytes(value) for value in states]
        list(self._pool.map(self._resume, range(len(states))))
        if "weights" in state:
            self._begin(Order(as_bytes(state["weights"]), None))

    def _resume(self, number: int) -> None:
        self._kept(number, lambda worker: worker.call("resume", self._states[number]))

    def close(self) -> None:
        """End the workers. A rollout that is under way is thrown away."""
        for future in self._pending:
            future.exception()
        self._pending = []
        list(self._pool.map(self._end, range(len(self._workers))))
        self._pool.shutdown()
        self._host.close()

    def __enter__(self) -> "WorkerRollouts":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _Worker:
    """A worker's collector and the rollouts that it makes."""

    def __init__(self, collector: RemoteCollector):
        self._collector = collector
        self._rollouts = iter(collector)

    def call(self, method: str, *arguments: Any) -> Any:
        """Return what a method of the worker's :class:`WorkerCollector` returns there."""
        return self._collector.map_fn(method, [arguments])[0]

    def turn(self, order: Order) -> tuple[TensorDictBase, Report]:
        """Return the rollout ``[n, steps]`` that the worker makes with some weights, and its report."""
        self.call("begin", order)
        rollout = next(self._rollouts).exclude("collector")
        return rollout.view(-1, rollout.shape[-1]), self.call("report")

    def close(self) -> None:
        """End the process."""
        self._collector.shutdown()


def _merged(gathered: Sequence[tuple[int, Mapping[str, float]]]) -> dict[str, float]:
    """Return means of means, weighted by numbers of robots, and sums of counts."""
    if len(gathered) == 1:  # as it is, without rounding
        return dict(gathered[0][1])
    totals: dict[str, float] = {}
    shares: dict[str, int] = {}
    for share, statistics in gathered:
        for name, value in statistics.items():
            totals[name] = totals.get(name, 0.0) + value * (1 if name == "broken" else share)
            shares[name] = shares.get(name, 0) + share
    return {name: total if name == "broken" else total / shares[name] for name, total in totals.items()}
