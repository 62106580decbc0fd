"""The parts of scenario_suite."""
