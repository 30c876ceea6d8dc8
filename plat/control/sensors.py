"""Simulated sensors of a robot: joint encoders, torques and an IMU, with noise and biases."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from plat.bounds import Bounded, NonNegative
from plat.control.simulator import Simulator

__all__ = ["SensorNoise", "SensorReading", "SimulatedSensors"]

_Floats = NDArray[np.float64]
_UP = np.array([0.0, 0.0, 9.81])  # m/s²: what an accelerometer at rest reads


@dataclass(frozen=True)
class SensorNoise(Bounded):
    """Standard deviations of sensor noise; biases are drawn once per reset."""

    joint_pos: NonNegative = 0.001
    """joint angles (rad)"""
    encoder_bias: NonNegative = 0.005
    """constant error of each joint angle (rad)"""
    joint_vel: NonNegative = 0.1
    """joint velocities (rad/s)"""
    torque: NonNegative = 1.0
    """joint torques (N m)"""
    gyro: NonNegative = 0.02
    """angular velocity (rad/s)"""
    gyro_bias: NonNegative = 0.005
    """constant error of the angular velocity (rad/s)"""
    acceleration: NonNegative = 0.2
    """specific force (m/s²)"""
    acceleration_bias: NonNegative = 0.05
    """constant error of the specific force (m/s²)"""


@dataclass(frozen=True)
class SensorReading:
    """Reading of all sensors at the end of a physics step."""

    joint_pos: _Floats
    """joint angles ``[J]`` (rad)"""
    joint_vel: _Floats
    """joint velocities ``[J]`` (rad/s)"""
    torque: _Floats
    """joint torques ``[J]`` (N m)"""
    gyro: _Floats
    """angular velocity ``[3]`` (rad/s, root frame)"""
    acceleration: _Floats
    """specific force ``[3]`` (m/s², root frame): mean over the physics step"""
    dt: float
    """seconds since the reading before"""


class SimulatedSensors:
    """Sensors of a simulated robot. The IMU is at the root's origin, and its axes are the root's.

    Args:
        simulator: the robot.
        noise: None for perfect sensors.
        seed: of noise and biases.

    >>> from plat.control import Simulator
    >>> from plat.keyframes import standing
    >>> from plat.robots import G1
    >>> simulator = Simulator(G1.model())
    >>> simulator.reset(standing(G1))
    >>> sensors = SimulatedSensors(simulator)
    >>> readings = sensors.step(G1.default_joint_pos.numpy())
    >>> len(readings), readings[0].dt
    (4, 0.005)
    """

    def __init__(self, simulator: Simulator, noise: SensorNoise | None = None, seed: int = 0):
        self._simulator = simulator
        self._noise = noise or SensorNoise(**dict.fromkeys(SensorNoise.__dataclass_fields__, 0.0))
        self._random = np.random.default_rng(seed)
        self.reset()

    def reset(self) -> None:
        """Draw new biases; call it after the simulator was reset."""
        joints, levels = self._simulator.model.nu, self._noise
        self._encoder_bias = levels.encoder_bias * self._random.standard_normal(joints)
        self._gyro_bias = levels.gyro_bias * self._random.standard_normal(3)
        self._acceleration_bias = levels.acceleration_bias * self._random.standard_normal(3)

    def read(self) -> SensorReading:
        """Return what the sensors say of a robot at rest; after a reset."""
        return self._reading(np.zeros(3))

    def step(self, joint_target: NDArray[np.floating]) -> list[SensorReading]:
        """Hold joint position targets ``[J]`` (rad) for a control step; return a reading per physics step.

        Raises:
            ActionError: as :meth:`plat.control.Simulator.step`.
        """
        data, dt = self._simulator.data, self._simulator.model.opt.timestep
        readings: list[SensorReading] = []
        before = data.qvel[:3].copy()

        def read() -> None:
            readings.append(self._reading((data.qvel[:3] - before) / dt))
            before[:] = data.qvel[:3]

        self._simulator.step(joint_target, read)
        return readings

    def _reading(self, acceleration_w: _Floats) -> SensorReading:
        data, levels = self._simulator.data, self._noise
        to_world = np.empty(9)
        mujoco.mju_quat2Mat(to_world, data.qpos[3:7])
        force = to_world.reshape(3, 3).T @ (acceleration_w + _UP)
        return SensorReading(
            joint_pos=self._noisy(data.qpos[7:] + self._encoder_bias, levels.joint_pos),
            joint_vel=self._noisy(data.qvel[6:], levels.joint_vel),
            torque=self._noisy(data.actuator_force, levels.torque),
            gyro=self._noisy(data.qvel[3:6] + self._gyro_bias, levels.gyro),
            acceleration=self._noisy(force + self._acceleration_bias, levels.acceleration),
            dt=self._simulator.model.opt.timestep,
        )

    def _noisy(self, values: _Floats, spread: float) -> _Floats:
        return values + spread * self._random.standard_normal(len(values))
