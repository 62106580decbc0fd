"""How long a battery drives the vehicle's computer, and the paper's figure 16 beside this computer. Every number says
whether it is a measurement, a model's or a claim of the paper."""

from dataclasses import dataclass
from pathlib import Path

import yaml

# Figure 16 and section VII.D of the paper, on a TX1: CPU in cores (of four), module in watts.
PAPER_CORES = {"speech": 4 * 0.20, "speech offloaded": 4 * 0.05, "detection": 4 * 0.25, "detection offloaded": 4 * 0.12}
PAPER_WATTS = {"all": 11.0, "slam, others offloaded": 5.0}
PAPER_HOURS, PAPER_GAIN = 5.0, 2.5
MEASURED, MODEL, CLAIM, ARITHMETIC = "measured", "model", "claim", "from its numbers"


@dataclass
class Battery:
    capacity_ah: float
    nominal_voltage: float

    def __post_init__(self):
        for name in ("capacity_ah", "nominal_voltage"):
            if not 0.0 < getattr(self, name) < 1e5:
                raise ValueError("battery %s = %g, must be above 0 and below 1e5" % (name, getattr(self, name)))

    @property
    def watt_hours(self):
        return self.capacity_ah * self.nominal_voltage

    def hours(self, watts):
        """@return None without watts"""
        return self.watt_hours / watts if watts else None

    def __str__(self):
        return "%g Ah at %g V" % (self.capacity_ah, self.nominal_voltage)


def read(folder, capacity_ah=None, nominal_voltage=None):
    """The battery of pi_vehicle's config/power.yaml, with other numbers where they are given.
    @param folder  of pi_vehicle. @throws ValueError naming the number that is wrong"""
    with open(Path(folder) / "config/power.yaml", encoding="utf-8") as file:
        default = yaml.safe_load(file)["battery"]
    return Battery(default["capacity_ah"] if capacity_ah is None else capacity_ah,
                   default["nominal_voltage"] if nominal_voltage is None else nominal_voltage)


def ratio(before, after):
    return before / after if before and after else None


def text(value, form, kind):
    return "-" if value is None else "%s (%s)" % (form % value, kind)


def figure_16(cores, watts, battery):
    """Rows [what, the paper's, here].
    @param cores  measured, by row of bench_power. @param watts  likewise, of CPU, board and radio, by the model"""
    rows = [["figure 16 and section VII.D", "paper (TX1)", "here"]]
    for name in ("speech", "detection"):
        for row in (name, name + " offloaded"):
            rows.append(["CPU, " + row, text(PAPER_CORES[row], "%.2f cores", MEASURED),
                         text(cores.get(row), "%.2f cores", MEASURED)])
        rows.append(["CPU, %s: times less" % name,
                     text(ratio(PAPER_CORES[name], PAPER_CORES[name + " offloaded"]), "%.1f", ARITHMETIC),
                     text(ratio(cores.get(name), cores.get(name + " offloaded")), "%.1f", MEASURED)])
    for row in PAPER_WATTS:
        rows.append(["power, " + row, text(PAPER_WATTS[row], "%.1f W", MEASURED), text(watts.get(row), "%.1f W", MODEL)])
    for row in PAPER_WATTS:
        rows.append(["battery of %s, %s" % (battery, row), text(battery.hours(PAPER_WATTS[row]), "%.1f h", ARITHMETIC),
                     text(battery.hours(watts.get(row)), "%.1f h", MODEL)])
    rows.append(["the paper's words: 2200 mAh, slam, others offloaded", text(PAPER_HOURS, "about %.0f h", CLAIM), "-"])
    gains = [ratio(one.get("all"), one.get("slam, others offloaded")) for one in (PAPER_WATTS, watts)]
    rows.append(["times longer by offloading", text(PAPER_GAIN, "%.1f", CLAIM) + ", " +
                 text(gains[0], "%.1f", ARITHMETIC), text(gains[1], "%.1f", MODEL)])
    return rows
