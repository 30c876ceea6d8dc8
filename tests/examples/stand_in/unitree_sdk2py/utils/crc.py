import struct
import zlib


class CRC:
    def Crc(self, message):
        numbers = [message.mode_pr, message.mode_machine]
        for motor in message.motor_cmd:
            numbers += [motor.mode, motor.q, motor.dq, motor.tau, motor.kp, motor.kd]
        return zlib.crc32(struct.pack(f"{len(numbers)}d", *numbers))
