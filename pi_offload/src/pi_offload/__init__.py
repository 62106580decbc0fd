"""Python tools of pi_offload: pictures of what the simulator found."""
