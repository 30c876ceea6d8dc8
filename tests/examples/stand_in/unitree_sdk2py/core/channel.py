import os
import pickle
import socket
import threading


def ChannelFactoryInitialize(domain, interface=None):
    pass


def _port(topic):
    return int(os.environ["STAND_IN_PORTS"].split(",")[{"rt/lowstate": 0, "rt/lowcmd": 1}[topic]])


class ChannelPublisher:
    def __init__(self, topic, kind):
        self._address, self._kind = ("127.0.0.1", _port(topic)), kind

    def Init(self):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def Write(self, message):
        assert isinstance(message, self._kind)
        self._socket.sendto(pickle.dumps(message), self._address)
        return True


class ChannelSubscriber:
    def __init__(self, topic, kind):
        self._port, self._kind = _port(topic), kind

    def Init(self, handler, length):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", self._port))
        threading.Thread(target=self._listen, args=(handler,), daemon=True).start()

    def _listen(self, handler):
        while True:
            message = pickle.loads(self._socket.recv(65536))
            assert isinstance(message, self._kind)
            handler(message)
