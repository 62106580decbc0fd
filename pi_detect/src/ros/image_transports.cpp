#include "ros/image_transports.h"

#include <stdexcept>

namespace pi_detect
{

void requireTransport(const image_transport::ImageTransport& transport, const std::string& name,
                      const std::string& parameter)
{
  std::string all;
  for (std::string known : transport.getLoadableTransports())
  {
    const std::string package = "image_transport/";
    known = known.rfind(package, 0) == 0 ? known.substr(package.size()) : known;
    if (known == name)
    {
      return;
    }
    all += (all.empty() ? "" : ", ") + known;
  }
  throw std::invalid_argument("parameter " + parameter + " = \"" + name + "\", must be one that is installed: " + all);
}

}  // namespace pi_detect
