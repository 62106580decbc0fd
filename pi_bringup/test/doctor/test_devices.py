"""Checks of devices on made-up folders."""

import unittest
from unittest import mock

from fake_root import FakeRoot
from pi_bringup.doctor import devices


class Devices(FakeRoot):
    def test_serial_ports(self):
        self.expect("WARN", devices.check_serial_ports(self.root), "there is none")
        self.put("dev/ttyUSB0")
        self.put("dev/ttyS0")  # there without anything behind it
        self.expect("OK", devices.check_serial_ports(self.root), "1 port(s): ttyUSB0")

    def test_the_chassis_port(self):
        self.expect("FAIL", devices.check_serial_ports(self.root, "/dev/ttyUSB7"), "/dev/ttyUSB7 is not there")
        self.put("dev/ttyUSB7")
        self.expect("OK", devices.check_serial_ports(self.root, "/dev/ttyUSB7"), "ttyUSB7")
        self.expect("OK", devices.check_serial_ports(self.root, "ttyUSB7"), "ttyUSB7")

    def test_rights(self):
        self.put("dev/ttyUSB0")
        self.put("dev/video0")
        self.put("dev/snd/pcmC1D0c")
        with mock.patch.object(devices.os, "access", return_value=False), \
                mock.patch.object(devices, "_group", return_value="root"):
            self.expect("FAIL", devices.check_serial_ports(self.root), "usermod -aG dialout")
            self.expect("FAIL", devices.check_cameras(self.root), "usermod -aG video")
            self.expect("FAIL", devices.check_microphones(self.root), "usermod -aG audio")
        with mock.patch.object(devices.os, "access", return_value=False), \
                mock.patch.object(devices, "_group", return_value="uucp"):
            self.expect("FAIL", devices.check_serial_ports(self.root), "usermod -aG uucp")

    def test_cameras(self):
        self.expect("WARN", devices.check_cameras(self.root), "no /dev/video*")
        self.put("dev/video0")
        self.put("sys/class/video4linux/video0/name", "Stereo Camera\n")
        self.expect("OK", devices.check_cameras(self.root), "video0", "Stereo Camera")

    def test_microphones(self):
        self.put("dev/snd/pcmC0D0p")  # plays only
        self.expect("WARN", devices.check_microphones(self.root), "no device that records")
        self.put("dev/snd/pcmC1D0c")
        self.put("proc/asound/cards", " 0 [PCH            ]: HDA-Intel - HDA Intel PCH\n  text\n"
                 " 1 [PnP            ]: USB-Audio - USB PnP Sound Device\n")
        self.expect("OK", devices.check_microphones(self.root), "pcmC1D0c", "USB PnP Sound Device")


if __name__ == "__main__":
    unittest.main()
