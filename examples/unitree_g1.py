"""Run a bundle on a Unitree G1 by unitree_sdk2py: low state in, low commands out.

python examples/unitree_g1.py bundle wave.json eth0

UNTRIED on a robot: only against a simulated G1 in another process, with the SDK on loopback and with a stand-in for it.
What is taken from the SDK: topics rt/lowstate and rt/lowcmd, messages of unitree_hg, mode_machine echoed from the
state, mode_pr 0, checksum by utils.crc, and the motion switcher to release the robot's own controller. Motors 0 to 28
are in plat's order of joints. Hang the robot up, keep a hand on the emergency stop, and read docs/onboard.md first.
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
from plat.deploy.safety import OnboardController, OnboardReading, SafetySettings
from plat.errors import PlatError
from plat.keyframes import KeyframeSequence

JOINTS = 29
# what a robot with 29 joints and the gears of g1_29dof_rev_1_0 says, and simulators that say nothing: others lock the
# waist, have 23 joints, or other motors
MACHINES = (5, 0)
IMU_POS = (0.04525, 0.0, -0.08339)  # m, in the pelvis' frame: Unitree's description
SILENCE = 0.2  # s without a state, by this computer's clock
FIRST = 10.0  # s to the first states, before anything moves
BACKLOG = 20  # states that may wait
STAND = 2.0  # s after the last keyframe


class G1:
    """Low-level connection to a G1: states of its motors and its IMU, and commands to its motors."""

    def __init__(self, interface: str | None = None):
        ChannelFactoryInitialize(0, *([interface] if interface else []))
        switcher = MotionSwitcherClient()
        switcher.SetTimeout(5.0)
        switcher.Init()
        code, mode = switcher.CheckMode()
        if code != 0:  # a simulated robot has no switcher
            print(f"no answer from the motion switcher ({code}): is the robot's own controller off?", file=sys.stderr)
        while mode and mode.get("name"):
            switcher.ReleaseMode()  # two controllers at once would shake the robot
            time.sleep(1.0)
            mode = switcher.CheckMode()[1]
        self._states: queue.Queue[Any] = queue.Queue(1000)
        self._publisher = ChannelPublisher("rt/lowcmd", LowCmd_)
        self._publisher.Init()
        self._subscriber = ChannelSubscriber("rt/lowstate", LowState_)
        self._subscriber.Init(self._states.put, 10)
        self._command, self._crc = unitree_hg_msg_dds__LowCmd_(), CRC()

    def receive(self, seconds: float) -> Any | None:
        """Return the next low state, or None after some seconds."""
        if self._states.qsize() > BACKLOG:  # slower than the robot: what it was then is of no use now
            while self._states.qsize() > 1:
                self._states.get()
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


def sensed(low: Any) -> OnboardReading:
    """Return what the controller reads from a low state."""
    motors, imu = low.motor_state[:JOINTS], low.imu_state
    return OnboardReading(
        joint_pos=np.array([motor.q for motor in motors]),
        joint_vel=np.array([motor.dq for motor in motors]),
        torque=np.array([motor.tau_est for motor in motors]),
        temperature=np.array([max(motor.temperature) for motor in motors]),  # of winding and shell
        gyro=np.array(imu.gyroscope),
        acceleration=np.array(imu.accelerometer),
    )


def main(bundle: Path, keyframes: Path, interface: str | None = None, settings: SafetySettings | None = None) -> str:
    """Run the keyframes; return the mode in which the controller ended."""
    runner = PolicyRunner(bundle)
    sequence = KeyframeSequence.load(keyframes, runner.robot, timing=runner.timing)
    estimator = StateEstimator(runner.robot, imu_pos=IMU_POS)
    settings = settings or SafetySettings(tilt=0.8)
    controller = OnboardController(runner, sequence, settings, estimator, anchor=sequence.start)
    robot = G1(interface)
    machine, began = 0, time.monotonic()
    ended: float | None = None
    try:
        while True:
            low = robot.receive(FIRST if controller.mode == "settle" else SILENCE)
            if low is None:  # of nothing is known where it is
                controller.stop("no low state came")
                return controller.mode
            # Unitree's simulator in Python leaves the tick at 0
            now = 1e-3 * low.tick if low.tick else time.monotonic() - began
            machine = low.mode_machine
            if machine not in MACHINES:
                raise PlatError(
                    f"the robot's mode_machine is {machine}, expected {MACHINES[0]}: policies know no other G1"
                )
            command = controller.step(now, sensed(low))
            if command is None:
                continue
            if controller.mode == "damping":
                return "damping"
            robot.send(command, machine)
            if controller.mode == "end":
                ended = now if ended is None else ended
                if now - ended > STAND:
                    return "end"
    finally:  # at the end, after an error and after Ctrl-C: brake
        robot.send(controller.stop("the end"), machine)
        for entry in controller.journal:
            print(f"{entry.first:.2f} s: {entry.piece}: {entry.reason} ({entry.steps} steps)", file=sys.stderr)


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit("usage: python examples/unitree_g1.py BUNDLE KEYFRAMES [INTERFACE]")
    try:
        print(main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3] if len(sys.argv) > 3 else None))
    except PlatError as error:
        sys.exit(f"error: {error}")
