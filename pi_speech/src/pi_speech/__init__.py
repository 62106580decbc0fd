"""Python tools of pi_speech: judging recognised commands and calibrating the confidence."""
