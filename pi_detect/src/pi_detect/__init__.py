"""Python tools of pi_detect: judging detections and fetching models."""
