"""CPU time and memory of the nodes, also of those that die and are started again."""

import time

from first_drive import measuring

NOT_OF_THE_VEHICLE = {"vehicle_simulator": "simulator", "microphone": "microphone", "rviz": "rviz",
                      "topic_monitor": "measuring", "drive_campus": "measuring",
                      "player": "recording", "player_recording": "recording", "sensor_recorder": "measuring",
                      "pi_core": "ROS core", "rosmaster": "ROS core", "rosout": "ROS core"}


class CpuAccount:
    """Sums the CPU time of each node over all processes it had."""

    def __init__(self, launch_pid, others):
        """@param others  {name: pid} of processes beside the launch."""
        self._launch_pid = launch_pid
        self._others = others
        self._last = {}    # (name, pid): seconds
        self._sums = {}    # name: seconds
        self.memory = {}   # name: as measuring.memory_mb
        self.pids = {}     # name: pid
        self._began = time.monotonic()
        self.seconds = 0.0  # from the begin to the last update
        self.update(first=True)

    def update(self, first=False):
        """Often enough that what a process did before it died is not missed."""
        self.pids = {**measuring.node_processes(self._launch_pid), **self._others}
        for name, pid in self.pids.items():
            seconds = measuring.cpu_seconds(pid)
            if seconds is None:
                continue
            before = self._last.get((name, pid), seconds if first else 0.0)
            self._sums[name] = self._sums.get(name, 0.0) + seconds - before
            self._last[(name, pid)] = seconds
        self.seconds = time.monotonic() - self._began

    def measure_memory(self):
        self.memory = {name: measuring.memory_mb(pid) for name, pid in self.pids.items()}

    def cores(self):
        """{name: cores}"""
        return {name: total / self.seconds for name, total in self._sums.items()} if self.seconds > 0 else {}


def group_of(name, edge_names):
    return "edge servers" if name in edge_names else NOT_OF_THE_VEHICLE.get(name, "vehicle")
