"""A simulated G1 behind the SDK or its stand-in: publishes low states, obeys low commands, 20 ms of simulation each.

python robot.py SECONDS; prints a JSON object at the end. Commands with a wrong checksum or mode_machine are not obeyed.
"""

import json
import queue
import sys

import mujoco
import numpy as np
from unitree_sdk2py.core.channel import ChannelFactoryInitialize, ChannelPublisher, ChannelSubscriber
from unitree_sdk2py.idl.default import unitree_hg_msg_dds__LowState_
from unitree_sdk2py.idl.unitree_hg.msg.dds_ import LowCmd_, LowState_
from unitree_sdk2py.utils.crc import CRC

from plat.control import SensorNoise, SimulatedSensors, Simulator
from plat.keyframes import standing
from plat.robots import G1

MACHINE = 5
WAIT, MOST_LOST = 5.0, 12  # s for a command, and how many may not come
ARM = np.array([0.04525, 0.0, -0.08339])


def main(seconds):
    simulator = Simulator(G1.model())
    simulator.reset(standing(G1))
    sensors = SimulatedSensors(simulator, SensorNoise(), seed=1)
    commands = queue.Queue()
    ChannelFactoryInitialize(0, "lo")
    publisher = ChannelPublisher("rt/lowstate", LowState_)
    publisher.Init()
    ChannelSubscriber("rt/lowcmd", LowCmd_).Init(commands.put, 10)
    tick, refused, lost, stiff, command = 0, 0, 0, False, None

    def publish(reading):
        nonlocal tick
        state = unitree_hg_msg_dds__LowState_()
        state.mode_machine, state.tick = MACHINE, tick
        # at the place of the IMU, but for the angular acceleration
        force = reading.acceleration + np.cross(reading.gyro, np.cross(reading.gyro, ARM))
        state.imu_state.gyroscope, state.imu_state.accelerometer = reading.gyro.tolist(), force.tolist()
        for motor, *values in zip(
            state.motor_state, reading.joint_pos, reading.joint_vel, reading.torque, strict=False
        ):
            motor.q, motor.dq, motor.tau_est = map(float, values)
        publisher.Write(state)
        tick += 5

    while tick < 1000 * seconds:
        try:
            # until it is commanded it hangs still, and says so at its pace
            command = commands.get(timeout=WAIT if stiff else 0.002)
        except queue.Empty:
            if not stiff:
                publish(sensors.read())
                continue
            lost += 1  # messages get lost: the motors hold what they were told
            if lost > MOST_LOST:
                break
        if command.mode_machine != MACHINE or command.crc != CRC().Crc(command):
            refused += 1
            continue
        motors = command.motor_cmd[:29]
        stiff = True
        if not any(motor.kp for motor in motors):
            break
        model = simulator.model
        model.actuator_gainprm[:, 0] = [motor.kp for motor in motors]
        model.actuator_biasprm[:, 1] = [-motor.kp for motor in motors]
        model.actuator_biasprm[:, 2] = [-motor.kd for motor in motors]
        for reading in sensors.step(np.array([motor.q for motor in motors])):
            publish(reading)
    position = simulator.data.qpos[:3].tolist()
    print(
        json.dumps(
            {
                "position": position,
                "seconds": tick / 1000,
                "refused": refused,
                "lost": lost,
                "version": mujoco.__version__,
            }
        )
    )


if __name__ == "__main__":
    main(float(sys.argv[1]))
