"""Tools of the vehicle: the doctor of its computer, the bench of power."""
