#pragma once

#include "modelled_atomics.h"

#include "shm/descriptor_ring.cpp"  // NOLINT: its functions have to be those of the model
