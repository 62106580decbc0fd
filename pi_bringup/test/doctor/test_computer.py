"""Checks of the computer on made-up folders."""

import os
import resource
import unittest
from unittest import mock

from fake_root import FakeRoot
from pi_bringup.doctor import computer

MEMINFO = "MemTotal:       8000000 kB\nMemFree: 100 kB\nMemAvailable:   %d kB\n"


class Computer(FakeRoot):
    def governor(self, name):
        for core in range(2):
            self.put(f"sys/devices/system/cpu/cpu{core}/cpufreq/scaling_governor", name + "\n")

    def test_processor(self):
        self.expect("OK", computer.check_processor(self.root, 4), "4 core(s)", "not told")
        self.expect("WARN", computer.check_processor(self.root, 1), "at least 2")
        self.governor("performance")
        self.expect("OK", computer.check_processor(self.root, 4), "governor performance")
        self.governor("powersave")
        self.expect("WARN", computer.check_processor(self.root, 4), "powersave", "scaling_governor")

    def test_processor_that_was_throttled(self):
        self.put("sys/devices/system/cpu/cpu0/thermal_throttle/package_throttle_count", "7")
        self.expect("WARN", computer.check_processor(self.root, 4), "throttled 7 times")

    def test_temperature(self):
        self.expect("OK", computer.check_temperature(self.root), "no sensor")
        self.put("sys/class/thermal/thermal_zone0/temp", "45000\n")
        self.put("sys/class/thermal/thermal_zone0/type", "soc")
        self.expect("OK", computer.check_temperature(self.root), "45 degrees (soc)")
        self.put("sys/class/thermal/thermal_zone0/trip_point_0_temp", "80000")
        self.put("sys/class/thermal/thermal_zone0/temp", "79000")
        self.expect("WARN", computer.check_temperature(self.root), "79 degrees")

    def test_memory(self):
        self.expect("WARN", computer.check_memory(self.root), "/proc/meminfo")
        self.put("proc/meminfo", MEMINFO % 6000000)
        self.expect("OK", computer.check_memory(self.root), "6.1 GB of 8.2 GB")
        self.put("proc/meminfo", MEMINFO % 500000)
        self.expect("WARN", computer.check_memory(self.root), "0.5 GB")

    def test_shared_memory(self):
        self.expect("FAIL", computer.check_shared_memory(self.root), "missing")
        (self.root / "dev/shm").mkdir(parents=True)
        usage = mock.Mock(free=1e9, total=2e9)
        with mock.patch.object(computer.shutil, "disk_usage", return_value=usage):
            self.expect("OK", computer.check_shared_memory(self.root), "1.0 GB of 2.0 GB")
            usage.free = 64e6  # as in a container
            self.expect("FAIL", computer.check_shared_memory(self.root), "--shm-size")
        with mock.patch.object(computer.os, "access", return_value=False):
            self.expect("FAIL", computer.check_shared_memory(self.root), "chmod 1777")

    def test_limits(self):
        limits = {"RLIMIT_MEMLOCK": resource.RLIM_INFINITY, "RLIMIT_NOFILE": 4096}
        with mock.patch.object(computer.os, "geteuid", return_value=1000):
            self.expect("OK", computer.check_limits(limits), "memlock unlimited")
            results = computer.check_limits({"RLIMIT_MEMLOCK": 65536, "RLIMIT_NOFILE": 256})
        self.assertEqual(["WARN", "FAIL"], [result.level for result in results])
        self.assertIn("memlock", results[0].advice)

    def test_scheduling(self):
        self.put("proc/sys/kernel/sched_rt_period_us", "1000000\n")
        self.put("proc/sys/kernel/sched_rt_runtime_us", "950000\n")
        self.expect("OK", computer.check_scheduling("", self.root), "up to 16")
        result = computer.check_scheduling("Operation not permitted", self.root)
        self.expect("WARN", result, "Operation not permitted")
        self.assertIn("rtprio 16", result.advice)
        self.assertNotIn("autogroup", result.text)
        self.put("proc/sys/kernel/sched_autogroup_enabled", "1\n")
        self.expect("WARN", computer.check_scheduling("Operation not permitted", self.root), "autogroup")
        group = "sys/fs/cgroup/cpu/init.scope/cpu.rt_runtime_us"
        self.put("proc/self/cgroup", "2:cpuacct:/\n1:cpu:/init.scope\n0::/init.scope\n")
        self.put(group, "0\n")
        self.expect("WARN", computer.check_scheduling("Operation not permitted", self.root), f"echo 500000 > /{group}")
        self.put(group, "500000\n")
        self.expect("WARN", computer.check_scheduling("Operation not permitted", self.root), "rtprio 16")
        self.put("proc/sys/kernel/sched_rt_runtime_us", "-1\n")
        self.expect("WARN", computer.check_scheduling("", self.root), "for good", "sched_rt_runtime_us=950000")
        self.put("proc/sys/kernel/sched_rt_runtime_us", "10000\n")
        self.expect("WARN", computer.check_scheduling("", self.root), "1 % of the time")

    def test_the_kernel_says_whether_it_grants_real_time_priorities(self):
        before = os.sched_getscheduler(0)
        self.assertIn(computer.real_time_denied(), (None, "Operation not permitted"))
        self.assertEqual(before, os.sched_getscheduler(0))

    def test_clock(self):
        self.expect("OK", computer.check_clock(0x2001, self.root), "is synchronised")
        self.put("proc/12/comm", "chronyd\n")
        self.expect("OK", computer.check_clock(0, self.root), "by chronyd")
        self.expect("WARN", computer.check_clock(computer.UNSYNCHRONISED, self.root), "not synchronised by chronyd")

    def test_the_kernel_answers(self):
        self.assertIsInstance(computer.clock_status(), int)

    def test_disk(self):
        usage = mock.Mock(free=10e9)
        with mock.patch.object(computer.shutil, "disk_usage", return_value=usage):
            self.expect("OK", computer.check_disk([self.root / "not" / "made" / "yet"])[0], "10.0 GB free")
            usage.free = 1e9
            self.expect("WARN", computer.check_disk([self.root])[0], "make room")
        with mock.patch.object(computer.os, "access", return_value=False):
            self.expect("FAIL", computer.check_disk([self.root])[0], "ROS_HOME")

    def test_power_sensors(self):
        self.expect("WARN", computer.check_power_sensors(self.root), "neither INA3221 nor RAPL")
        zone = self.put("sys/class/powercap/intel-rapl:0/energy_uj", "123")
        self.put("sys/class/powercap/intel-rapl:0/name", "package-0")
        self.expect("OK", computer.check_power_sensors(self.root), "1 values of package-0")
        real = computer.Path.read_text

        def read_text(path, *arguments, **options):
            if path == zone:
                raise PermissionError(13, "Permission denied")
            return real(path, *arguments, **options)

        with mock.patch.object(computer.Path, "read_text", read_text):
            self.expect("WARN", computer.check_power_sensors(self.root), "/sys/class/powercap/intel-rapl:0/energy_uj",
                        "chmod a+r")

    def test_load(self):
        self.expect("WARN", computer.check_load(self.root, 2), "/proc/loadavg")
        self.put("proc/loadavg", "0.50 1.0 1.0 1/100 7")
        self.expect("OK", computer.check_load(self.root, 2), "0.5 on 2")
        self.put("proc/loadavg", "9.50 1.0 1.0 1/100 7")
        self.expect("WARN", computer.check_load(self.root, 2), "end other programs")

    def test_supply(self):
        self.expect("OK", computer.check_supply("throttled=0x0"), "no under-voltage")
        self.expect("WARN", computer.check_supply("throttled=0x50005"), "power supply")
        self.expect("OK", computer.check_supply("garbage"), "no under-voltage")


if __name__ == "__main__":
    unittest.main()
