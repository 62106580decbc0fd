"""What launch files pass on, and what they refuse, without a graph: roslaunch reads them and starts nothing."""

import subprocess
import unittest
from pathlib import Path

import yaml

EXAMPLE = Path(__file__).resolve().parents[3] / "pi_node" / "config" / "vehicle.yaml"
NO_MASTER = "http://localhost:1"  # roslaunch does not get so far


def roslaunch(*words):
    return subprocess.run(["env", "ROS_MASTER_URI=" + NO_MASTER, "roslaunch", *words], stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=120, check=False)


class LaunchFiles(unittest.TestCase):
    def test_simulation_passes_on_what_a_user_changes(self):
        given = {"model": ("/ssd/model", "/my/model.yaml"), "target": ("/ssd/target", "opencl"),
                 "commands": ("/recognizer/commands", "/my/commands.yaml"),
                 "command_actions": ("/command/actions_file", "/my/actions.yaml"),
                 "reaction_rules": ("/reaction/rules_file", "/my/rules.yaml"),
                 "map_file": ("/vio/map_file", "/my/place.map"), "save_map": ("/vio/save_map", True),
                 "pose_file": ("/pose_keeper/file", "/my/pose"),
                 "scenario": ("/vehicle_simulator/scenario", "/my/scenario.yaml"),
                 "recordings": ("/recorder/folder", "/my/recordings"),
                 "seed": ("/vehicle_simulator/scenario_seed", 7),
                 "background": ("/microphone/background", "/my/wind.wav"),
                 "background_level": ("/microphone/background_level_dbfs", -35.5)}
        result = roslaunch("--dump-params", "pi_bringup", "simulation.launch",
                           *("%s:=%s" % (argument, value) for argument, (_, value) in given.items()))
        parameters = yaml.safe_load(result.stdout)
        self.assertEqual(dict(given.values()), {name: parameters.get(name) for name, _ in given.values()},
                         result.stderr)

    def test_the_vehicle_is_described_once(self):
        for launched in ("vehicle.launch", "simulation.launch"):
            parameters = yaml.safe_load(roslaunch("--dump-params", "pi_bringup", launched).stdout)
            self.assertEqual([1.0, 3.0], [parameters.get("/vehicle/" + name) for name in ("footprint/front", "limits/speed")])
            self.assertIn('<robot name="example">', parameters["/robot_description"])
            self.assertEqual([], [name for name in parameters if "/vehicle/" in name[1:]])
        alone = yaml.safe_load(roslaunch("--dump-params", "pi_detect", "obstacles.launch").stdout)
        self.assertEqual(1.0, alone.get("/obstacles/vehicle/footprint/front"))

    def test_the_page_is_on_loopback_and_off_in_simulation(self):
        for arguments, page in ((["vehicle.launch"], ("127.0.0.1", False)), (["simulation.launch"], (None, None)),
                                (["vehicle.launch", "web_address:=0.0.0.0", "web_control:=true"], ("0.0.0.0", True)),
                                (["simulation.launch", "web:=true", "web_control:=true"], ("127.0.0.1", True))):
            result = roslaunch("--dump-params", "pi_bringup", *arguments)
            parameters = yaml.safe_load(result.stdout)
            self.assertEqual(page, (parameters.get("/web_view/address"), parameters.get("/web_view/allow_control")),
                             result.stderr)

    def test_a_stock_base_is_chosen_by_one_argument(self):
        result = roslaunch("--dump-params", "pi_bringup", "simulation.launch", "base:=twist")
        parameters = yaml.safe_load(result.stdout)
        for name, value in (("/vehicle_simulator/base", "twist"), ("/vehicle/kind", "differential"),
                            ("/chassis/steering_angle", False), ("/chassis/port", None)):
            self.assertEqual(value, parameters.get(name), result.stderr)
        self.assertIn('<robot name="differential">', parameters["/robot_description"])
        given = yaml.safe_load(roslaunch("--dump-params", "pi_bringup", "simulation.launch", "base:=twist",
                                         f"vehicle:={EXAMPLE}").stdout)
        self.assertEqual("ackermann", given.get("/vehicle/kind"))
        started = roslaunch("--args", "/chassis", "pi_bringup", "vehicle.launch", "base:=twist")
        self.assertIn("twist_base_node", started.stdout, started.stderr)

    def test_an_opencl_device_is_chosen_by_one_argument(self):
        for target, kernels in (("cpu", False), ("opencl", True)):
            for manager in ("false", "true"):
                result = roslaunch("--dump-params", "pi_bringup", "vehicle.launch", f"target:={target}",
                                   f"together:={manager}")
                parameters = yaml.safe_load(result.stdout)
                for name, value in (("/ssd/target", target), ("/vio/tracker/kernel_tasks", kernels),
                                    ("/vio/map/kernel_tasks", kernels)):
                    self.assertEqual(value, parameters.get(name), result.stderr)

    def test_frames_of_the_sensors_are_published_but_for_recordings(self):
        for arguments, published in ((["vehicle.launch"], True), (["replay.launch", "bag:=/etc/hostname"], False),
                                     (["drive.launch"], True), (["drive.launch", "data:=/etc"], False)):
            nodes = roslaunch("--nodes", "pi_bringup", *arguments).stdout.split()
            self.assertEqual(published, "/robot_state_publisher" in nodes, arguments)

    def test_a_wrong_description_is_one_error_that_names_it(self):
        result = roslaunch("pi_bringup", "vehicle.launch", "vehicle:=/nowhere/vehicle.yaml")
        self.assertEqual(1, result.returncode)
        self.assertIn("vehicle_urdf: /nowhere/vehicle.yaml cannot be read", result.stderr)

    def test_the_black_box_is_on_unless_it_is_switched_off(self):
        for arguments, is_on in ((), True), (("together:=true",), True), (("record:=false",), False):
            result = roslaunch("--dump-params", "pi_bringup", "vehicle.launch", *arguments)
            self.assertEqual(is_on, "/recorder/folder" in yaml.safe_load(result.stdout), result.stderr)

    def test_sensors_are_switched_on_by_one_argument(self):
        file = Path(__file__).resolve().parents[2] / "launch" / "sensors.launch"
        result = roslaunch("--dump-params", "pi_bringup", "vehicle.launch", f"sensors:={file}")
        parameters = yaml.safe_load(result.stdout)
        for name, value in (("/camera/device", "/dev/video0"), ("/camera/right_device", ""), ("/camera/frame_rate", 60.0),
                            ("/imu/port", "/dev/ttyUSB1"), ("/imu/imu_frame", "imu_link")):
            self.assertEqual(value, parameters.get(name), result.stderr)
        nodes = roslaunch("--nodes", str(file), "imu:=false", "mounts:=false").stdout.split()
        self.assertEqual(["/camera"], nodes)

    def test_replay_of_a_bag_that_is_not_there_is_an_error_that_names_it(self):
        result = roslaunch("pi_bringup", "replay.launch", "bag:=/nowhere/drive.bag")
        self.assertEqual(1, result.returncode)
        self.assertIn("/nowhere/drive.bag", result.stderr)


if __name__ == "__main__":
    unittest.main()
