"""Run a bundle on a Unitree G1 by unitree_sdk2py: low state in, low commands out.

python examples/unitree_g1.py bundle wave.json eth0

UNTRIED on a robot and with the real SDK: only tried against a simulated G1 in another process, with a stand-in for the
SDK that has the same classes and topics. What is taken from the SDK: topics rt/lowstate and rt/lowcmd, messages of
unitree_hg, mode_machine echoed from the state, mode_pr 0, checksum by utils.crc, and the motion switcher to release the
robot's own controller. Motors 0 to 28 are in plat's order of joints. Hang the robot up, keep a hand on the emergency
stop, and read docs/onboard.md first.
"""

import queue
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from unitree_sdk2py.comm.motion_switcher.motion_switcher_client import MotionSwitcherClient
from unitree_sdk2py.core.channel import ChannelFactoryInitialize, ChannelPublisher, ChannelSubscriber
from unitree_sdk2py.idl.default import unitree_hg_msg_dds__LowCmd_
from unitree_sdk2py.idl.unitree_hg.msg.dds_ import LowCmd_, LowState_
from unitree_sdk2py.utils.crc import CRC

from plat.deploy import JointCommand, PolicyRunner, StateEstimator
from plat.deploy.safety import SafeRunner, SafetySettings
from plat.keyframes import KeyframeSequence

JOINTS = 29
IMU_POS = (0.04525, 0.0, -0.08339)  # m, in the pelvis' frame: Unitree's description
SILENCE = 0.2  # s without a state, by this computer's clock
STAND = 2.0  # s after the last keyframe


class G1:
    """Low-level connection to a G1: states of its motors and its IMU, and commands to its motors."""

    def __init__(self, interface: str | None = None):
        ChannelFactoryInitialize(0, *([interface] if interface else []))
        switcher = MotionSwitcherClient()
        switcher.SetTimeout(5.0)
        switcher.Init()
        while (mode := switcher.CheckMode()[1]) and mode.get("name"):
            switcher.ReleaseMode()  # two controllers at once would shake the robot
            time.sleep(1.0)
        self._states: queue.Queue[Any] = queue.Queue(1000)
        self._publisher = ChannelPublisher("rt/lowcmd", LowCmd_)
        self._publisher.Init()
        self._subscriber = ChannelSubscriber("rt/lowstate", LowState_)
        self._subscriber.Init(self._states.put, 10)
        self._command, self._crc = unitree_hg_msg_dds__LowCmd_(), CRC()

    def receive(self, seconds: float) -> Any | None:
        """Return the next low state, or None after some seconds."""
        try:
            return self._states.get(timeout=seconds)
        except queue.Empty:
            return None

    def send(self, command: JointCommand, mode_machine: int) -> None:
        """Send targets and gains; the motors close the loop."""
        message = self._command
        message.mode_pr, message.mode_machine = 0, mode_machine
        for joint in range(JOINTS):
            motor = message.motor_cmd[joint]
            motor.mode, motor.tau, motor.dq = 1, 0.0, 0.0
            motor.q, motor.kp, motor.kd = (float(values[joint]) for values in command)
        message.crc = self._crc.Crc(message)
        self._publisher.Write(message)


def sensed(low: Any) -> dict[str, np.ndarray]:
    """Return what the estimator reads from a low state."""
    motors = low.motor_state[:JOINTS]
    return {
        "joint_pos": np.array([motor.q for motor in motors]),
        "joint_vel": np.array([motor.dq for motor in motors]),
        "torque": np.array([motor.tau_est for motor in motors]),
        "gyro": np.array(low.imu_state.gyroscope, dtype=np.float64),
        "acceleration": np.array(low.imu_state.accelerometer, dtype=np.float64),
    }


def main(bundle: Path, keyframes: Path, interface: str | None = None, settings: SafetySettings | None = None) -> str:
    """Run the keyframes; return the mode in which the safe runner ended."""
    runner = PolicyRunner(bundle)
    sequence = KeyframeSequence.load(keyframes, runner.robot, timing=runner.timing)
    estimator = StateEstimator(runner.robot, imu_pos=IMU_POS)
    safe = SafeRunner(
        runner, sequence, settings or SafetySettings(tilt=0.8), on_start=lambda _: estimator.anchor(sequence.start)
    )
    robot = G1(interface)
    still: list[dict[str, np.ndarray]] = []
    tick, sent, ended, machine = None, -np.inf, None, 0
    while True:
        low = robot.receive(SILENCE)
        if low is None:  # of nothing is known where it is: brake
            safe.stop(f"no low state for {SILENCE} s")
            robot.send(safe.step(0.0 if tick is None else tick, None), machine)
            return safe.mode
        machine, now, reading = low.mode_machine, 1e-3 * low.tick, sensed(low)
        if len(still) < 200:  # stands or hangs still at first: tilt and bias of the gyroscope
            still.append(reading)
            names = ("joint_pos", "gyro", "acceleration")
            state = estimator.reset(*(np.mean([each[name] for each in still], 0) for name in names))
        elif tick is not None and now > tick:
            state = estimator.update(**reading, dt=min(now - tick, 0.5))  # messages get lost
        tick = now
        if len(still) < 200 or now - sent < runner.robot.control_dt - 1e-6:
            continue
        robot.send(safe.step(now, state), machine)
        sent = now
        if safe.mode == "damping":
            return safe.mode
        if safe.mode == "end":
            ended = now if ended is None else ended
            if now - ended > STAND:
                safe.stop("the end")
                robot.send(safe.step(now, state), machine)
                return "end"


if __name__ == "__main__":
    print(main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3] if len(sys.argv) > 3 else None))
