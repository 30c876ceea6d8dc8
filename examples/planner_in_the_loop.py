"""A program sends keyframes over a socket while a robot moves: what a teleoperator or a large model would do.

python examples/planner_in_the_loop.py bundle      # the bundle of a policy that knows partial keyframes: imagined-g1

The robot is a simulated one: noisy sensors, state estimator and safe runner of plat.deploy at 50 Hz. Ten times a second
it says what time it is, and a second process answers with places for both hands 0.4 s ahead. Messages are JSON, one a
line: {"put": keyframe, "replace": true}, {"cancel": true}.
"""

import json
import math
import socket
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from plat.deploy import Bundle, KeypointKinematics, PolicyRunner, RobotDescription, StateEstimator
from plat.deploy.safety import SafeRunner, SafetySettings
from plat.errors import PlatError
from plat.keyframes import Keyframe, KeyframeQueue, keyframe_from_json, keyframe_to_json, only, standing

LONGEST_LINE = 100_000
HANDS = ("left_wrist_yaw_link", "right_wrist_yaw_link")


class Lines:
    """Messages over a socket: a JSON object a line."""

    def __init__(self, connection: socket.socket):
        self._connection, self._rest = connection, b""
        self.open = True

    def send(self, message: dict[str, Any]) -> None:
        """Send a message; a partner that has gone closes the connection."""
        try:
            self._connection.sendall(json.dumps(message).encode() + b"\n")
        except OSError:
            self.open = False

    def receive(self, seconds: float) -> list[Any]:
        """Return what has come, after at most some seconds; what is no JSON comes as None."""
        self._connection.settimeout(max(seconds, 1e-4))
        try:
            data = self._connection.recv(65536)
            self.open = self.open and bool(data)
        except TimeoutError:
            data = b""
        except OSError:
            data, self.open = b"", False
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._rest = self._rest[-LONGEST_LINE:]  # a partner that never ends a line must not fill the memory
        return [_parsed(line) for line in lines]


def _parsed(line: bytes) -> Any:
    try:
        return json.loads(line)
    except (ValueError, RecursionError):
        return None


class SimulatedRobot:
    """Robot in MuJoCo whose state is known by noisy sensors and an estimator only."""

    def __init__(self, description: RobotDescription):
        from plat.control import SensorNoise, SimulatedSensors, Simulator
        from plat.robots import get_robot

        self.simulator = Simulator(get_robot(description.name).model(), description.control_dt)
        self.simulator.reset(standing(description))
        self._sensors = SimulatedSensors(self.simulator, SensorNoise())
        self._estimator = StateEstimator(description)
        still = [self._sensors.read() for _ in range(100)]
        names = ("joint_pos", "gyro", "acceleration")
        self.state = self._estimator.reset(*(np.mean([getattr(each, name) for each in still], 0) for name in names))

    def step(self, joint_target: np.ndarray) -> None:
        """Advance by a control step."""
        for each in self._sensors.step(joint_target):
            sensed = (each.joint_pos, each.joint_vel, each.gyro, each.acceleration)
            self.state = self._estimator.update(*sensed, each.dt, each.torque)

    def hands(self) -> np.ndarray:
        """Return where the hands are in truth ``[2, 3]`` (m, world)."""
        return self.simulator.data.xpos[[self.simulator.model.body(hand).id for hand in HANDS]].copy()


def robot_side(bundle: Path, lines: Lines, seconds: float, lockstep: bool = False) -> dict[str, Any]:
    """Run the robot until its planner has gone, or for some seconds; return what happened.

    With ``lockstep`` the robot waits for the planner, for machines that are too slow for real time.
    """
    policy = PolicyRunner(bundle)
    description, dt = policy.robot, policy.robot.control_dt
    kinematics = KeypointKinematics(description)
    robot = SimulatedRobot(description)
    queue = KeyframeQueue(description, policy.timing)
    safe = SafeRunner(policy, queue, SafetySettings(ramp=0.2))
    rows = [description.keypoints.index(hand) for hand in HANDS]
    answers: list[str] = []
    errors: list[float] = []
    began, now = time.monotonic(), 0.0
    for step in range(round(seconds / dt)):
        command = safe.step(now, robot.state)
        clock = safe.elapsed(now)
        if step % 5 == 0 and lines.open and safe.mode in ("run", "end"):
            lines.send({"time": clock})
            for message in lines.receive(10.0 if lockstep else 0.0):
                answers.append(obey(message, queue, clock, standing_at(description, robot.state.root_pos_w)))
        wanted = queue.command(clock)
        if wanted is not None and not wanted.keyframe.whole and clock > 0.5:
            pose = wanted.keyframe
            places = kinematics(pose.root_pos, pose.root_quat, pose.joint_pos)[rows]
            errors.append(float(np.linalg.norm(robot.hands() - places, axis=1).mean()))
        robot.step(command.position)
        now += dt
        if not lockstep:
            time.sleep(max(0.0, began + now - time.monotonic()))
        if not lines.open and safe.mode == "end":
            break
    return {
        "mode": safe.mode,
        "seconds": round(now, 2),
        "answers": dict(Counter(answers)),
        "hands_off": float(np.mean(errors)) if errors else None,
        "height": float(robot.simulator.data.qpos[2]),
        "stepped_in": [f"{entry.piece}: {entry.reason}" for entry in safe.journal],
    }


def obey(message: Any, queue: KeyframeQueue, now: float, here: Keyframe) -> str:
    """Do what a message says; return what became of it."""
    try:
        if isinstance(message, dict) and "put" in message:
            keyframe = keyframe_from_json(message["put"], queue.robot)
            return queue.put(keyframe, now, replace_all=bool(message.get("replace")))
        if isinstance(message, dict) and "cancel" in message:
            queue.stay(here, now)
            return "canceled"
    except PlatError as error:
        return f"refused: {error}"
    return "refused: expected an object with 'put' or 'cancel'"


def standing_at(robot: RobotDescription, place: np.ndarray) -> Keyframe:
    """Return the default pose where a robot is: what it does when a command is canceled."""
    pose = standing(robot)
    return replace(pose, root_pos=np.array([place[0], place[1], pose.root_pos[2]]))


def planner_side(bundle: Path, lines: Lines, seconds: float) -> None:
    """Send places for both hands, on a circle, whenever the robot says what time it is; then one late, and cancel."""
    robot = Bundle.from_json((bundle / "bundle.json").read_text(), str(bundle)).robot
    while lines.open:
        for now in [message["time"] for message in lines.receive(1.0) if message]:
            if now >= seconds:
                late = only(robot, now - 0.2, bodies={HANDS[0]: (0.3, 0.2, 0.9)})
                lines.send({"put": keyframe_to_json(late, robot)})
                lines.send({"cancel": True})
                return
            turn = 2 * math.pi * now / 2.0
            across, up = 0.05 * math.cos(turn), 0.9 + 0.05 * math.sin(turn)
            places = {HANDS[0]: (0.3, 0.2 + across, up), HANDS[1]: (0.3, -0.2 + across, up)}
            keyframe = only(robot, now + 0.4, bodies=places)
            lines.send({"put": keyframe_to_json(keyframe, robot), "replace": True})


def main(bundle: Path, seconds: float = 5.0, lockstep: bool = False) -> dict[str, Any]:
    """Start the planner in a process of its own and run the robot; return what happened."""
    PolicyRunner(bundle)  # what is no bundle shows before there are two processes
    with socket.create_server(("127.0.0.1", 0)) as server:
        program = [sys.executable, __file__, str(bundle), "--planner", str(server.getsockname()[1]), str(seconds)]
        with subprocess.Popen(program) as planner:
            server.settimeout(60)
            connection, _ = server.accept()
            with connection:
                result = robot_side(bundle, Lines(connection), seconds + 5.0, lockstep)
            planner.wait(60)
    return result


if __name__ == "__main__":
    if len(sys.argv) == 1:
        sys.exit("usage: python examples/planner_in_the_loop.py BUNDLE")
    if sys.argv[2:3] == ["--planner"]:
        with socket.create_connection(("127.0.0.1", int(sys.argv[3]))) as connection:
            planner_side(Path(sys.argv[1]), Lines(connection), float(sys.argv[4]))
    else:
        try:
            print(json.dumps(main(Path(sys.argv[1])), indent=1))
        except PlatError as error:
            sys.exit(f"error: {error}")
