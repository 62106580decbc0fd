#pragma once

#include <pi_node/test_support/message_of.h>

using pi_node::test_support::messageOf;
