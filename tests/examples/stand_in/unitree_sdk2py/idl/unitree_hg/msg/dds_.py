from dataclasses import dataclass, field

MOTORS = 35


@dataclass
class IMUState_:
    quaternion: list = field(default_factory=lambda: [1.0, 0.0, 0.0, 0.0])
    gyroscope: list = field(default_factory=lambda: [0.0] * 3)
    accelerometer: list = field(default_factory=lambda: [0.0] * 3)


@dataclass
class MotorState_:
    q: float = 0.0
    dq: float = 0.0
    tau_est: float = 0.0
    temperature: list = field(default_factory=lambda: [40, 35])


@dataclass
class MotorCmd_:
    mode: int = 0
    q: float = 0.0
    dq: float = 0.0
    tau: float = 0.0
    kp: float = 0.0
    kd: float = 0.0


@dataclass
class LowState_:
    mode_machine: int = 0
    tick: int = 0
    imu_state: IMUState_ = field(default_factory=IMUState_)
    motor_state: list = field(default_factory=lambda: [MotorState_() for _ in range(MOTORS)])


@dataclass
class LowCmd_:
    mode_pr: int = 0
    mode_machine: int = 0
    motor_cmd: list = field(default_factory=lambda: [MotorCmd_() for _ in range(MOTORS)])
    crc: int = 0
