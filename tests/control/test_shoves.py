import numpy as np
import pytest

from plat.control import Simulator
from plat.control.shoves import Shoves
from plat.keyframes import standing
from plat.robots import G1


@pytest.fixture
def simulator() -> Simulator:
    simulator = Simulator(G1.model())
    simulator.reset(standing(G1))
    return simulator


def velocities(shoves: Shoves, simulator: Simulator, steps: int) -> np.ndarray:
    """Root velocities ``[steps, 3]`` that the shoves alone give a robot whose physics stands still."""
    seen = []
    for _ in range(steps):
        shoves.after_step(simulator)
        seen.append(simulator.data.qvel[:3].copy())
    return np.array(seen)


def test_a_shove_comes_at_every_interval_with_its_speed(
    simulator: Simulator, capsys: pytest.CaptureFixture[str]
) -> None:
    changes = np.diff(velocities(Shoves(0.5, 0.1, seed=0, control_dt=0.02), simulator, 16), axis=0, prepend=0.0)
    speed = np.linalg.norm(changes, axis=1)
    np.testing.assert_array_equal(np.flatnonzero(speed), [4, 9, 14])
    np.testing.assert_allclose(speed[[4, 9, 14]], 0.5)
    np.testing.assert_array_equal(changes[:, 2], 0.0)
    assert capsys.readouterr().out.splitlines()[1].startswith("shove of 0.5 m/s at 0.20 s, ")


def test_the_seed_fixes_the_directions() -> None:
    def run(seed: int) -> np.ndarray:
        return velocities(Shoves(1.0, 0.02, seed, control_dt=0.02), Simulator(G1.model()), 5)

    np.testing.assert_array_equal(run(3), run(3))
    assert (run(3) != run(4)).any()


def test_no_speed_is_no_shove(simulator: Simulator) -> None:
    assert not velocities(Shoves(0.0, 0.02, seed=0, control_dt=0.02), simulator, 5).any()
