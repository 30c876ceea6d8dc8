class MotionSwitcherClient:
    def __init__(self):
        self._modes = [{"name": ""}, {"name": "ai"}]

    def SetTimeout(self, seconds):
        pass

    def Init(self):
        pass

    def CheckMode(self):
        return 0, self._modes[-1]

    def ReleaseMode(self):
        self._modes.pop()
        return 0, None
