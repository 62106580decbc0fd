"""The parts of drive_demo."""
