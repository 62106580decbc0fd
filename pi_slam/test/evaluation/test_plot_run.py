import contextlib
import importlib.machinery
import importlib.util
import io
import math
from pathlib import Path
import tempfile
import unittest

PROGRAM = str(Path(__file__).resolve().parents[2] / "scripts" / "plot_run")
loader = importlib.machinery.SourceFileLoader("plot_run", PROGRAM)
plot_run = importlib.util.module_from_spec(importlib.util.spec_from_loader("plot_run", loader))
loader.exec_module(plot_run)

SECOND = 1000000000
TOP_VIEW, SIDE_VIEW, UPPER, LOWER = range(4)


def circle():
    """Rows of a circle of 3 m with errors that grow."""
    rows = [["name", "circle"], ["pairs", "201"], ["poses", "201"], ["path_m", "18.8"], ["se3_rmse_m", "0.012"],
            ["yaw_rmse_m", "0.5"], ["rotation_rmse_rad", "0.01"]]
    estimate = [["trajectory", "odometry"]]
    for i in range(201):
        angle = 2 * math.pi * i / 200
        stamp = str(1000 * SECOND + i * SECOND // 20)
        x, y = math.cos(angle), math.sin(angle)
        rows.append(["truth", stamp, str(3 * x), str(3 * y), "0"])
        estimate.append(["pose", stamp, str(3.2 * x), str(3.2 * y), str(0.1 * x), str(angle)])
        estimate.append(["error", stamp, str(0.001 * i), str(0.0002 * i)])
    return rows + estimate


def second_trajectory(rows):
    begin = rows.index(["trajectory", "odometry"])
    return [["trajectory", "map"], *[row[:2] + [str(float(row[2]) + 0.5)] + row[3:] if row[0] == "pose" else row
                                     for row in rows[begin + 1:]]]


class TestPlotRun(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def draw(self, rows):
        """The figure, rendered."""
        figure = plot_run.draw(plot_run.Run(rows))
        self.addCleanup(plot_run.pyplot.close, figure)
        figure.canvas.draw()
        return figure

    def lines(self, figure, axes, color):
        return [line for line in figure.axes[axes].lines if line.get_color() == color and len(line.get_xdata()) > 1]

    def run_program(self, *arguments):
        """The exit status and what it wrote on standard error."""
        with contextlib.redirect_stderr(io.StringIO()) as errors:
            status = plot_run.main([str(argument) for argument in arguments])
        return status, errors.getvalue()

    def test_has_the_promised_size(self):
        figure = self.draw(circle())
        self.assertEqual((1600, 1000), tuple(figure.canvas.get_width_height()))

    def test_shows_estimate_truth_and_errors(self):
        figure = self.draw(circle())
        for view in (TOP_VIEW, SIDE_VIEW):
            for color in (plot_run.CURVES[0], plot_run.TRUTH):
                self.assertEqual([201], [len(line.get_xdata()) for line in self.lines(figure, view, color)])
        for axes in (UPPER, LOWER):
            self.assertEqual([201], [len(line.get_xdata()) for line in self.lines(figure, axes, plot_run.CURVES[0])])
        self.assertEqual("Position error [m]", figure.axes[UPPER].get_title("left"))
        self.assertEqual(["ground truth", "odometry (dot: start)"],
                         [text.get_text() for text in figure.legends[0].get_texts()])
        self.assertEqual([], self.lines(figure, TOP_VIEW, plot_run.CURVES[1]))
        texts = [text.get_text() for text in figure.texts]
        self.assertEqual("circle: ATE 12.0 mm", texts[0])
        self.assertEqual("201 stereo pairs, 201 poses, path 18.8 m;  RMSE of position after SE3 alignment 12.0 mm, "
                         "after yaw alignment 500 mm;  rotation 0.57 deg", texts[1])

    def test_does_not_join_poses_that_are_far_apart(self):
        rows = circle()
        sparse = [row for i, row in enumerate(second_trajectory(rows)) if row[0] != "pose" or not 20 < i < 300]
        figure = self.draw(rows + sparse)
        for view in (TOP_VIEW, SIDE_VIEW):
            self.assertEqual(["-"], [line.get_linestyle() for line in self.lines(figure, view, plot_run.CURVES[0])])
            self.assertEqual(["None"], [line.get_linestyle() for line in self.lines(figure, view, plot_run.CURVES[1])])

    def test_scales_both_directions_of_the_path_equally(self):
        figure = self.draw(circle())
        for view in (TOP_VIEW, SIDE_VIEW):
            to_pixels = figure.axes[view].transData.transform
            across, up = to_pixels((3, 3)) - to_pixels((-3, -3))
            self.assertAlmostEqual(across, up, delta=0.5)
        across, _ = (figure.axes[TOP_VIEW].transData.transform((3, 0)) -
                     figure.axes[TOP_VIEW].transData.transform((-3, 0)))
        self.assertGreater(across, 300)

    def test_errors_rise_from_left_to_right(self):
        line, = self.lines(self.draw(circle()), UPPER, plot_run.CURVES[0])
        self.assertEqual(sorted(line.get_xdata()), list(line.get_xdata()))
        self.assertEqual(sorted(line.get_ydata()), list(line.get_ydata()))
        self.assertAlmostEqual(10.0, line.get_xdata()[-1])
        self.assertAlmostEqual(0.2, line.get_ydata()[-1])

    def test_shades_spans_and_draws_a_second_trajectory(self):
        rows = circle()
        rows += second_trajectory(rows)
        self.assertEqual([], self.draw(rows).axes[UPPER].patches[:])
        rows.append(["span", "blind", str(1002 * SECOND), str(1003 * SECOND)])
        figure = self.draw(rows)
        for axes in (UPPER, LOWER):
            span, = figure.axes[axes].patches
            box = span.get_window_extent()
            self.assertAlmostEqual(0.1 * figure.axes[axes].bbox.width, box.width, delta=2)  # 1 of 10 s
        self.assertEqual(1, len(self.lines(figure, TOP_VIEW, plot_run.CURVES[1])))
        self.assertEqual("blind", figure.legends[0].get_texts()[-1].get_text())

    def test_shows_the_motion_without_truth(self):
        rows = [row for row in circle() if row[0] in ("name", "pairs", "poses", "trajectory", "pose")]
        figure = self.draw(rows)
        self.assertEqual("circle: no ground truth", figure.texts[0].get_text())
        self.assertEqual("Distance from the start [m]", figure.axes[UPPER].get_title("left"))
        distance, = self.lines(figure, UPPER, plot_run.CURVES[0])
        self.assertAlmostEqual(6.4, max(distance.get_ydata()), delta=0.01)
        heading, = self.lines(figure, LOWER, plot_run.CURVES[0])
        self.assertAlmostEqual(360.0, heading.get_ydata()[-1])

    def test_survives_empty_and_useless_numbers(self):
        for rows in ([], [["pose", "5000000000", "1", "1", "0", "0"]],
                     [["pose", "5000000000", "nan", "1", "0", "nan"], ["pose", "6000000000", "1e300", "-1e300", "0", "0"],
                      ["pose", "7000000000", "0", "0", "0", "0"], ["error", "5000000000", "nan", "0"],
                      ["error", "6000000000", "1e300", "inf"]],
                     [["pose", "5000000000", "9e11", "0", "0", "0"], ["pose", "6000000000", "9e11", "0", "0", "0"],
                      ["error", "5000000000", "9e11", "9e11"]]):
            figure = self.draw([["name", "\u03c0 $ and \ufffd"], ["trajectory", "odometry"], *rows])
            self.assertEqual((1600, 1000), tuple(figure.canvas.get_width_height()))

    def test_refuses_what_does_not_fit_together(self):
        with self.assertRaisesRegex(plot_run.RunError, "has no trajectory"):
            plot_run.Run([])
        with self.assertRaisesRegex(plot_run.RunError, "line 2 is no row of a run: error,5,0.1"):
            plot_run.Run([["trajectory", "odometry"], ["error", "5", "0.1"]])

    def test_writes_the_picture_beside_the_run(self):
        run = self.folder / "est_tum.run.csv"
        run.write_text("".join(",".join(row) + "\n" for row in circle()))
        self.assertEqual((0, ""), self.run_program(run))
        self.assertEqual(b"\x89PNG", (self.folder / "est_tum.png").read_bytes()[:4])
        status, errors = self.run_program(self.folder / "none.run.csv")
        self.assertEqual(1, status)
        self.assertIn("none.run.csv: No such file", errors)
        status, errors = self.run_program(run, self.folder / "missing" / "plot.png")
        self.assertEqual(1, status)
        self.assertIn("plot.png", errors)


if __name__ == "__main__":
    unittest.main()
