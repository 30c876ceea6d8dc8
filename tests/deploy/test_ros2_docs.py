"""The node of docs/ros2.md runs with stand-ins for ROS 2, and its fields are those of the public messages."""

import re
import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from plat.deploy.safety import SafetySettings
from plat.keyframes import KeyframeSequence, standing
from plat.robots import G1

PAGE = (Path(__file__).parents[2] / "docs" / "ros2.md").read_text()
(PROGRAM,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


# the fields of unitree_hg, all of them, so that a wrong name fails; slots, so that none can be added
@dataclass(slots=True)
class MotorCmd:
    mode: int = 0
    q: float = 0.0
    dq: float = 0.0
    tau: float = 0.0
    kp: float = 0.0
    kd: float = 0.0
    reserve: int = 0


@dataclass(slots=True)
class LowCmd:
    mode_pr: int = 0
    mode_machine: int = 0
    motor_cmd: list[MotorCmd] = field(default_factory=lambda: [MotorCmd() for _ in range(35)])
    reserve: list[int] = field(default_factory=lambda: [0] * 4)
    crc: int = 0


@dataclass(slots=True)
class MotorState:
    mode: int = 0
    q: float = 0.0
    dq: float = 0.0
    ddq: float = 0.0
    tau_est: float = 0.0
    temperature: list[int] = field(default_factory=lambda: [40, 35])
    vol: float = 0.0
    sensor: list[int] = field(default_factory=lambda: [0] * 2)
    motorstate: int = 0
    reserve: list[int] = field(default_factory=lambda: [0] * 4)


@dataclass(slots=True)
class IMUState:
    quaternion: list[float] = field(default_factory=lambda: [1.0, 0.0, 0.0, 0.0])
    gyroscope: list[float] = field(default_factory=lambda: [0.0] * 3)
    accelerometer: list[float] = field(default_factory=lambda: [0.0] * 3)
    rpy: list[float] = field(default_factory=lambda: [0.0] * 3)
    temperature: int = 30


@dataclass(slots=True)
class LowState:
    version: list[int] = field(default_factory=lambda: [0] * 2)
    mode_pr: int = 0
    mode_machine: int = 0
    tick: int = 0
    imu_state: IMUState = field(default_factory=IMUState)
    motor_state: list[MotorState] = field(default_factory=lambda: [MotorState() for _ in range(35)])
    wireless_remote: list[int] = field(default_factory=lambda: [0] * 40)
    reserve: list[int] = field(default_factory=lambda: [0] * 4)
    crc: int = 0


class Node:
    """Stand-in for rclpy's node: what was published, and who subscribed."""

    def __init__(self, name):
        self.sent, self.topics = [], {}

    def create_publisher(self, kind, topic, depth):
        self.topics[topic] = kind
        return self

    def create_subscription(self, kind, topic, callback, depth):
        self.topics[topic] = kind

    def create_timer(self, period, callback):
        self.period = period

    def publish(self, message):
        self.sent.append(message)


@pytest.fixture
def program(monkeypatch) -> dict:
    rclpy, node, hg, message = (ModuleType(name) for name in ("rclpy", "rclpy.node", "unitree_hg", "unitree_hg.msg"))
    node.Node, message.LowCmd, message.LowState = Node, LowCmd, LowState
    for module in (rclpy, node, hg, message):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    names: dict = {"__name__": "plat_node"}
    exec(compile(PROGRAM, "docs/ros2.md", "exec"), names)
    return names


def test_the_checksum_is_the_sdks(program):
    """Recorded with Unitree's own library."""
    command = LowCmd(mode_machine=5)
    command.motor_cmd[3].q = 0.25
    assert program["checksum"](command) == 1972583703


def test_the_node_ramps_and_brakes(program, bundle, tmp_path):
    KeyframeSequence(G1, standing(G1), (standing(G1).at(1.0),)).save(tmp_path / "stand.json")
    node = program["PlatNode"](bundle, tmp_path / "stand.json", SafetySettings(settle=0.1, ramp=0.2))
    assert node.topics == {"/lowcmd": LowCmd, "/lowstate": LowState}
    random = np.random.default_rng(0)

    def hear(tick: int) -> None:
        state = LowState(mode_machine=5, tick=tick)
        for motor, angle in zip(state.motor_state, G1.default_joint_pos.tolist(), strict=False):
            motor.q = angle + 1e-4 * random.standard_normal()
        state.imu_state.gyroscope = (0.01 * random.standard_normal(3)).tolist()
        state.imu_state.accelerometer = [0.0, 0.0, 9.81 + 0.01 * random.standard_normal()]
        node.on_state(state)

    for _ in range(5):  # the robot is not there yet
        node.on_timer()
    assert not node.sent
    for tick in range(1000, 1250, 5):
        hear(tick)
        if tick % 100 == 0:
            node.on_timer()
    assert node.controller.mode == "ramp"
    last = node.sent[-1]
    assert last.mode_machine == 5
    assert last.crc == program["checksum"](last)
    np.testing.assert_allclose([motor.q for motor in last.motor_cmd[:29]], G1.default_joint_pos, atol=0.01)
    assert all(motor.kp > 0 and motor.kd > 0 for motor in last.motor_cmd[:29])
    assert not any(motor.mode for motor in last.motor_cmd[29:])
    for _ in range(3):
        node.on_timer()
    assert node.controller.mode == "damping"
    assert not any(motor.kp for motor in node.sent[-1].motor_cmd)
    assert node.sent[-1].motor_cmd[0].kd > 0
