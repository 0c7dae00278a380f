"""A listener that notes what it hears."""


class Heard:
    """Notes each stage, how many steps it has, and how many of them are done."""

    def __init__(self):
        self.stages = []

    def started(self, stage, total):
        self.stages.append([stage, total, 0])

    def advanced(self, steps):
        self.stages[-1][2] += steps

    def finished(self):
        pass
