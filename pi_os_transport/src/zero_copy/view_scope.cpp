#include "pi_os_transport/zero_copy/serialization.h"

namespace pi_os_transport::zero_copy
{
namespace
{

thread_local ViewScope* innermost = nullptr;

}  // namespace

ViewScope::ViewScope(const uint8_t* begin, size_t length) : begin_(begin), length_(length), outer_(innermost)
{
  innermost = this;
}

ViewScope::~ViewScope()
{
  innermost = outer_;
}

ViewScope* ViewScope::current()
{
  return innermost;
}

}  // namespace pi_os_transport::zero_copy
