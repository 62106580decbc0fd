#!/usr/bin/python3 -B
"""Judge of runtime_services.test."""

import json
import os
import queue
import sys
import tempfile
import threading
import unittest

import numpy
import rospy
import rostest
from pi_runtime.msg import EtcEntry, GraphEdge, Task, TaskReport

import runtime_harness as harness
from runtime_harness import halve_picture_task, halve_task, halved_size, in_, out, picture, until

HEIGHT, WIDTH = 60, 83
MAX_WAITING_CALLS = 1  # of slow_runtime
MAX_TASKS = 3          # likewise


class RuntimeServices(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("runtime_services")
        cls.runtime = harness.Services("/runtime")
        cls.slow = harness.Services("/slow_runtime")
        cls.image = picture(HEIGHT, WIDTH)
        cls.large = picture(1000, 2000)

    def run_task(self, task):
        response = self.runtime.submit_task(task=task, wait=True)
        self.assertTrue(response.accepted, response.message)
        self.assertTrue(response.ended, response.message)
        self.assertEqual(response.id, response.report.id)
        return response.report

    def assert_image(self, expected, report, index=0):
        self.assertEqual(TaskReport.OK, report.outcome, report.message)
        actual = numpy.frombuffer(report.outputs[index].data, numpy.uint8).reshape(expected.shape)
        self.assertTrue(numpy.array_equal(expected, actual))

    def unit(self, name):
        return {unit.name: unit for unit in self.runtime.list_units().units}[name]

    def report_of(self, services, task_id):
        def ended():
            response = services.query_task(id=task_id)
            self.assertTrue(response.success, response.message)
            return response.report if response.ended else None
        return until(ended, "task %d ends" % task_id)

    # ------------------------------------------------------------------------------------------------ what there is

    def test_units_are_listed(self):
        units = self.runtime.list_units().units
        self.assertEqual(["cpu0", "cpu1"], [unit.name for unit in units if unit.type == "cpu"])
        for unit in units[:2]:
            self.assertIn("native", unit.executors)
            self.assertEqual(1, unit.compute_units)
            self.assertEqual(1, len(unit.cores))
            self.assertFalse(unit.failed)
            self.assertEqual(float("inf"), unit.bandwidth_bps)

    def test_codelets_are_listed_with_what_they_take(self):
        codelets = {codelet.name: codelet for codelet in self.runtime.list_codelets().codelets}
        self.assertLessEqual({"blob", "hamming", "pyramid_down"}, set(codelets))
        self.assertFalse({"gaussian_blur7", "hamming_filter", "orb", "remap"} & set(codelets))
        down = codelets["pyramid_down"]
        self.assertTrue(down.native and down.opencl and down.sliceable)
        self.assertIn("Gaussian", down.description)
        self.assertIn("2 value {width, height, source_stride, destination_stride, levels}", down.arguments)

    # -------------------------------------------------------------------------------------------------------- tasks

    def test_a_task_gives_the_result_of_the_reference(self):
        report = self.run_task(halve_picture_task(self.image, client_key="first"))
        self.assert_image(harness.halved(self.image), report)
        self.assertEqual("first", report.client_key)
        self.assertIn(report.unit, ("cpu0", "cpu1"))
        self.assertIn(report.executor, ("native", "opencl"))
        self.assertTrue(0 < report.submitted_ns <= report.started_ns <= report.finished_ns)
        self.assertEqual((0, False), (report.deadline_ns, report.deadline_missed))

    def test_a_task_runs_where_it_must(self):
        for unit in ("cpu0", "cpu1"):
            self.assertEqual(unit, self.run_task(halve_picture_task(self.image, unit=unit)).unit)

    def test_a_deadline_counts_from_submission(self):
        task = halve_picture_task(self.image, deadline=rospy.Duration(20, 1))
        report = self.run_task(task)
        self.assertEqual(20000000001, report.deadline_ns - report.submitted_ns)
        self.assertFalse(report.deadline_missed)
        task.deadline = rospy.Duration(0, 1)
        self.assertTrue(self.run_task(task).deadline_missed)

    def test_a_report_can_be_asked_for_later(self):
        response = self.runtime.submit_task(task=halve_picture_task(self.image))
        self.assertTrue(response.accepted, response.message)
        self.assertFalse(response.ended)
        report = self.report_of(self.runtime, response.id)
        self.assert_image(harness.halved(self.image), report)
        self.assert_image(harness.halved(self.image), self.runtime.query_task(id=response.id).report)

    def test_a_report_that_was_handed_over_is_not_kept(self):
        report = self.run_task(halve_picture_task(self.image))
        response = self.runtime.query_task(id=report.id)
        self.assertFalse(response.success)
        self.assertIn("no task %d is known" % report.id, response.message)
        self.assertIn("report_keep_s", response.message)

    def test_tasks_on_the_topic_are_answered_on_the_topic(self):
        reports = queue.Queue()
        subscriber = rospy.Subscriber("/runtime/results", TaskReport, reports.put)
        publisher = rospy.Publisher("/runtime/tasks", Task, queue_size=10)
        until(lambda: publisher.get_num_connections() and subscriber.get_num_connections(), "the topics are connected")
        images = {str(seed): picture(HEIGHT, WIDTH, seed) for seed in range(5)}
        for key, image in images.items():
            publisher.publish(halve_picture_task(image, client_key=key))
        publisher.publish(Task(codelet="unknown", client_key="wrong"))
        seen = {}
        while len(seen) < len(images) + 1:
            report = reports.get(timeout=harness.TIMEOUT_S)
            seen[report.client_key] = report
        for key, image in images.items():
            self.assert_image(harness.halved(image), seen[key])
        self.assertEqual((TaskReport.REFUSED, 0), (seen["wrong"].outcome, seen["wrong"].id))
        self.assertIn("there is no codelet \"unknown\"", seen["wrong"].message)

    # --------------------------------------------------------------------------------------- graphs and kept buffers

    def test_a_graph_chains_its_tasks_by_a_buffer_that_stays(self):
        height, width = (HEIGHT + 1) // 2, (WIDTH + 1) // 2
        tasks = [halve_task(in_(self.image.tobytes()), out(height * width, "half"), HEIGHT, WIDTH),
                 halve_task(in_(b"", "half"), out(halved_size(height, width)), height, width)]
        edges = [GraphEdge(predecessor=0, successor=1, bytes=height * width)]
        response = self.runtime.submit_graph(tasks=tasks, edges=edges, wait=True)
        self.assertTrue(response.accepted, response.message)
        self.assertTrue(response.ended, response.message)
        self.assertEqual(list(response.ids), [report.id for report in response.reports])
        first, second = response.reports
        self.assertEqual(TaskReport.OK, first.outcome, first.message)
        self.assertEqual(("half", b""), (first.outputs[0].buffer, first.outputs[0].data))
        self.assert_image(harness.halved(harness.halved(self.image)), second)
        self.assertLessEqual(first.finished_ns, second.started_ns)

        statistics = self.runtime.get_statistics().statistics
        self.assertIn("half", statistics.kept_buffers)
        self.assertGreaterEqual(statistics.kept_buffer_bytes, height * width)
        self.assertTrue(self.runtime.drop_buffer(name="half").success)
        response = self.runtime.drop_buffer(name="half")
        self.assertEqual((False, 'there is no kept buffer "half"'), (response.success, response.message))

    def test_successors_of_a_task_that_fails_are_cancelled(self):
        wrong = halve_task(in_(b"short"), out(self.image.size, "never"), HEIGHT, WIDTH)
        after = halve_task(in_(b"", "never"), out(10000), HEIGHT, WIDTH)
        response = self.runtime.submit_graph(tasks=[wrong, after], edges=[GraphEdge(predecessor=0, successor=1)],
                                             wait=True)
        self.assertEqual([TaskReport.EXECUTION_FAILED, TaskReport.CANCELLED],
                         [report.outcome for report in response.reports], response.message)

    def test_a_graph_that_turns_in_circles_is_refused(self):
        task = halve_picture_task(self.image)
        response = self.runtime.submit_graph(tasks=[task, task], edges=[GraphEdge(predecessor=0, successor=1),
                                                                        GraphEdge(predecessor=1, successor=0)])
        self.assertFalse(response.accepted)
        self.assertNotEqual("", response.message)

    def test_kept_buffers_have_a_limit(self):
        response = self.runtime.submit_task(task=halve_task(in_(bytes(100)), out(2 << 20, "huge"), HEIGHT, WIDTH))
        self.assertFalse(response.accepted)
        self.assertIn('buffer "huge" of 2097152 bytes does not fit', response.message)
        self.assertIn("max_kept_buffer_mb", response.message)

    # --------------------------------------------------------------------------------------------- what is wrong

    def test_wrong_names_and_sizes_are_named(self):
        def problem(task):
            response = self.runtime.submit_task(task=task, wait=True)
            return response.report.message if response.accepted else "refused: " + response.message
        self.assertIn('refused: there is no codelet "blur", there are ', problem(Task(codelet="blur")))
        self.assertIn("pyramid_down: argument 0 there is no kept buffer",
                      problem(halve_task(in_(b"", "nothing"), out(10), HEIGHT, WIDTH)))
        self.assertIn("pyramid_down: argument 0 (source) has 5 bytes, must have at least %d" % self.image.size,
                      problem(halve_task(in_(b"12345"), out(self.image.size), HEIGHT, WIDTH)))
        task = halve_picture_task(self.image)
        task.range = 7
        self.assertIn("the range is 7, must be %d (rows of the destination)" % ((HEIGHT + 1) // 2), problem(task))
        self.assertIn('refused: there is no unit "gpu9"', problem(halve_picture_task(self.image, unit="gpu9")))
        self.assertIn("refused: stream = 77", problem(halve_picture_task(self.image, stream=77)))
        self.assertIn("refused: size = nan", problem(halve_picture_task(self.image, size=float("nan"))))
        self.assertIn("deadline = -1", problem(halve_picture_task(self.image, deadline=rospy.Duration(-1))))

    def test_wrong_parameters_end_the_node_with_one_clear_error(self):
        for parameter, error in (("_slice:=0", "parameter /wrong/slice = 0 us, must be above 0"),
                                 ("_max_tasks:=none", "parameter /wrong/max_tasks = none, must be a whole number"),
                                 ("_queue_order:=lifo", 'queue order "lifo" is unknown, must be edf or fifo')):
            node = harness.start("pi_runtime", "runtime_node", "__name:=wrong", parameter)
            output, _ = node.communicate(timeout=harness.TIMEOUT_S)
            rospy.delete_param("/wrong")
            self.assertEqual(1, node.returncode, output)
            lines = [line for line in output.splitlines() if "FATAL" in line]
            self.assertEqual(1, len(lines), output)
            self.assertIn(error, lines[0])

    # ------------------------------------------------------------------------------------------------- the scheduler

    def test_run_times_can_be_seen_and_set(self):
        self.run_task(halve_picture_task(self.image))
        entries = self.runtime.get_etc().entries
        self.assertIn("pyramid_down", [entry.codelet for entry in entries])
        self.assertTrue(all(entry.mean_s > 0 and entry.count > 0 for entry in entries))
        entry = EtcEntry(codelet="blob", bucket=12, column="cpu1/native", count=5, mean_s=0.25, variance_s2=0.5)
        response = self.runtime.set_etc(clear=True, entries=[entry])
        self.assertTrue(response.success, response.message)
        self.assertEqual([entry], self.runtime.get_etc().entries)
        response = self.runtime.set_etc(entries=[EtcEntry(codelet="blob", column="cpu1/native", count=1, mean_s=-1)])
        self.assertFalse(response.success)
        self.assertIn("mean", response.message)

    def test_the_policy_can_be_seen_and_set(self):
        before = self.runtime.get_policy().policy
        self.assertEqual(("search", "heft"), (before.inter_core_policy, before.inner_core_policy))
        policy = self.runtime.get_policy().policy
        policy.inter_core_policy, policy.diff_min_order, policy.gamma = "diff_min", "min", 0.5
        policy.inner_core_policy, policy.level_barrier = "levels", False
        self.assertTrue(self.runtime.set_policy(policy=policy).success)
        self.assertEqual(policy, self.runtime.get_policy().policy)
        self.assert_image(harness.halved(self.image), self.run_task(halve_picture_task(self.image)))
        wrong = self.runtime.get_policy().policy
        wrong.inter_core_policy, wrong.inner_core_policy = "mct", "fastest"
        response = self.runtime.set_policy(policy=wrong)
        self.assertFalse(response.success)
        self.assertIn("fastest", response.message)
        self.assertEqual(policy, self.runtime.get_policy().policy)
        self.assertTrue(self.runtime.set_policy(policy=before).success)

    def test_streams_are_admitted_while_there_is_room(self):
        request = {"codelet": "pyramid_down", "size": (HEIGHT + 1) // 2, "period": rospy.Duration(0.1)}
        admission = self.runtime.admit_stream(name="camera", wcet=rospy.Duration(0.01), **request)
        self.assertTrue(admission.admitted, admission.reason)
        report = self.run_task(halve_picture_task(self.image, stream=admission.id))
        self.assertEqual(100000000, report.deadline_ns - report.submitted_ns)
        stream = {stream.id: stream for stream in self.runtime.list_streams().streams}[admission.id]
        self.assertEqual(("camera", 0.1, 0.1, 0.01, 1), (stream.name, stream.period_s, stream.deadline_s,
                                                         stream.wcet_s, stream.jobs))
        refused = self.runtime.admit_stream(name="too much", wcet=rospy.Duration(0.2), **request)
        self.assertEqual((False, 0), (refused.admitted, refused.id))
        self.assertIn("cpu0", refused.reason)
        self.assertIn("cpu1", refused.reason)
        self.assertTrue(self.runtime.retire_stream(id=admission.id).success)
        response = self.runtime.retire_stream(id=admission.id)
        self.assertEqual("no stream %d is admitted" % admission.id, response.message)

    def test_runtime_top_shows_units_and_streams(self):
        admission = self.runtime.admit_stream(name="camera", codelet="pyramid_down", size=100, period=rospy.Duration(0.1),
                                              wcet=rospy.Duration(0.01))
        self.assertTrue(admission.admitted, admission.reason)
        self.addCleanup(self.runtime.retire_stream, id=admission.id)
        top = harness.start("pi_runtime", "runtime_top", "--node", "/runtime", "--count", "2")
        text, _ = top.communicate(timeout=harness.TIMEOUT_S)
        self.assertEqual(0, top.returncode, text)
        lines = text.splitlines()
        self.assertEqual(2, sum(line.startswith("2 units, 1 streams") for line in lines), text)
        self.assertEqual(2, sum(line.startswith("cpu1 ") for line in lines), text)
        stream = [line.split() for line in lines if line.startswith("camera ")][-1]
        self.assertIn(stream[1], ("cpu0", "cpu1"))
        self.assertEqual(["100.0", "100.0", "10.0"], stream[3:6])

    def test_a_stream_of_size_0_counts_as_1(self):
        admission = self.runtime.admit_stream(name="unsized", codelet="pyramid_down", period=rospy.Duration(0.1),
                                              wcet=rospy.Duration(0.001))
        self.assertTrue(admission.admitted, admission.reason)
        self.assertTrue(self.runtime.retire_stream(id=admission.id).success)

    def test_impossible_streams_are_refused_with_a_reason(self):
        refused = self.runtime.admit_stream(name="x", codelet="blur", period=rospy.Duration(1))
        self.assertIn('there is no codelet "blur"', refused.reason)
        refused = self.runtime.admit_stream(name="x", codelet="blob", period=rospy.Duration(-1))
        self.assertIn("period = -1", refused.reason)

    def test_a_unit_can_be_taken_out_and_brought_back(self):
        self.addCleanup(self.runtime.set_unit_available, unit="cpu0", available=True)
        self.assertTrue(self.runtime.set_unit_available(unit="cpu0", available=False).success)
        unit = self.unit("cpu0")
        self.assertTrue(unit.failed)
        self.assertNotEqual("", unit.failure)
        self.assertEqual("cpu1", self.run_task(halve_picture_task(self.image)).unit)
        report = self.run_task(halve_picture_task(self.image, unit="cpu0"))
        self.assertEqual(TaskReport.UNIT_FAILED, report.outcome)
        self.assertIn("cpu0 is out: taken out by request", report.message)
        self.assertTrue(self.runtime.set_unit_available(unit="cpu0", available=True).success)
        self.assertFalse(self.unit("cpu0").failed)
        self.assertEqual("cpu0", self.run_task(halve_picture_task(self.image, unit="cpu0")).unit)
        response = self.runtime.set_unit_available(unit="cpu7", available=False)
        self.assertEqual(False, response.success)
        self.assertIn("cpu7", response.message)

    def test_statistics_count(self):
        before = self.runtime.get_statistics().statistics
        self.run_task(halve_picture_task(self.image))
        self.run_task(halve_task(in_(b"short"), out(10), HEIGHT, WIDTH))
        after = self.runtime.get_statistics().statistics
        self.assertEqual((2, 1, 1), (after.submitted - before.submitted, after.ended_ok - before.ended_ok,
                                     after.failed - before.failed))
        self.assertEqual(0, after.open_tasks)

    def test_the_trace_is_saved(self):
        report = self.run_task(halve_picture_task(self.image))
        with tempfile.TemporaryDirectory() as folder:
            chrome, gantt = os.path.join(folder, "trace.json"), os.path.join(folder, "trace.png")
            response = self.runtime.save_trace(chrome_path=chrome, gantt_path=gantt)
            self.assertTrue(response.success, response.message)
            with open(chrome) as file:
                events = json.load(file)["traceEvents"]
            with open(gantt, "rb") as file:
                self.assertEqual(b"\x89PNG\r\n\x1a\n", file.read(8))
            only = os.path.join(folder, "only.png")
            self.assertTrue(self.runtime.save_trace(gantt_path=only).success)
            self.assertEqual({"only.png", "trace.json", "trace.png"}, set(os.listdir(folder)))
        runs = [event for event in events if event["ph"] == "X" and event.get("args", {}).get("task") == report.id]
        self.assertEqual(["pyramid_down"], [event["name"] for event in runs])
        self.assertGreater(response.tasks, 0)

    def test_a_trace_that_cannot_be_saved_says_why(self):
        self.run_task(halve_picture_task(self.image))
        response = self.runtime.save_trace(chrome_path="/nowhere/trace.json")
        self.assertEqual("trace /nowhere/trace.json cannot be written: No such file or directory",
                         response.message)
        self.assertIn("neither", self.runtime.save_trace().message)
        self.assertIn("trace_capacity", self.slow.save_trace(chrome_path="/nowhere/trace.json").message)

    # --------------------------------------------------------------------------------------- what takes a long time

    def submit_slow(self, **fields):
        response = self.slow.submit_task(task=halve_picture_task(self.large, **fields))
        self.assertTrue(response.accepted, response.message)
        return response.id

    def test_a_task_that_has_not_begun_is_cancelled(self):
        running = self.submit_slow()
        queued = self.submit_slow()
        response = self.slow.cancel_task(id=queued)
        self.assertTrue(response.success, response.message)
        self.assertEqual(TaskReport.CANCELLED, self.report_of(self.slow, queued).outcome)
        self.slow.cancel_task(id=running)
        self.report_of(self.slow, running)
        response = self.slow.cancel_task(id=queued)
        self.assertEqual((False, "no task %d is open: it has ended, or never was there" % queued),
                         (response.success, response.message))

    def test_open_tasks_have_a_limit(self):
        ids = [self.submit_slow() for _ in range(MAX_TASKS)]
        response = self.slow.submit_task(task=halve_picture_task(self.large))
        self.assertFalse(response.accepted)
        self.assertIn("max_tasks = %d" % MAX_TASKS, response.message)
        for task_id in reversed(ids):
            self.slow.cancel_task(id=task_id)
        for task_id in ids:
            self.report_of(self.slow, task_id)

    def test_a_call_that_waits_keeps_nobody_else_waiting(self):
        answers = queue.Queue()
        waiting = threading.Thread(target=lambda: answers.put(
            self.slow.submit_task(task=halve_picture_task(self.large), wait=True)))
        waiting.start()
        until(lambda: self.slow.get_statistics().statistics.open_tasks, "the task is there")
        self.assertEqual(1, len(self.slow.list_units().units))
        response = self.slow.submit_task(task=halve_picture_task(self.large), wait=True)
        self.assertTrue(response.accepted)
        self.assertFalse(response.ended)
        self.assertIn("max_waiting_calls = %d" % MAX_WAITING_CALLS, response.message)
        self.assertTrue(answers.empty(), "the first call waits still")
        self.slow.cancel_task(id=response.id)
        self.assertEqual(TaskReport.OK, answers.get(timeout=harness.TIMEOUT_S).report.outcome)
        waiting.join()

    def test_a_wait_ends_with_its_timeout(self):
        response = self.slow.submit_task(task=halve_picture_task(self.large), wait=True, timeout=rospy.Duration(0.01))
        self.assertTrue(response.accepted)
        self.assertFalse(response.ended)
        self.assertIn("timeout", response.message)
        self.slow.cancel_task(id=response.id)
        self.assertEqual(TaskReport.CANCELLED, self.report_of(self.slow, response.id).outcome)


if __name__ == "__main__":
    rostest.rosrun("pi_runtime", "runtime_services", RuntimeServices, sys.argv)
