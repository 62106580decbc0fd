#include "rosout/tcpros_header.h"

#include <array>
#include <cstdint>

#include "pi_os_transport/little_endian.h"

namespace pi_os_transport
{
namespace
{

constexpr size_t LENGTH_BYTES = 4;

void appendLength(std::string* out, size_t length)
{
  std::array<uint8_t, LENGTH_BYTES> bytes;
  storeLittleEndian(bytes.data(), static_cast<uint32_t>(length));
  out->append(bytes.begin(), bytes.end());
}

uint32_t lengthAt(std::string_view bytes)
{
  return loadLittleEndian<uint32_t>(reinterpret_cast<const uint8_t*>(bytes.data()));
}

}  // namespace

std::string encodeTcprosHeader(const TcprosHeader& header)
{
  std::string fields;
  for (const auto& [name, value] : header)
  {
    appendLength(&fields, name.size() + 1 + value.size());
    fields.append(name).append("=").append(value);
  }
  std::string out;
  appendLength(&out, fields.size());
  return out += fields;
}

std::optional<TcprosHeader> decodeTcprosHeader(std::string_view fields)
{
  TcprosHeader header;
  while (!fields.empty())
  {
    if (fields.size() < LENGTH_BYTES || lengthAt(fields) > fields.size() - LENGTH_BYTES)
    {
      return std::nullopt;
    }
    const std::string_view field = fields.substr(LENGTH_BYTES, lengthAt(fields));
    const size_t equals = field.find('=');
    if (equals == std::string_view::npos)
    {
      return std::nullopt;
    }
    header[std::string(field.substr(0, equals))] = field.substr(equals + 1);
    fields.remove_prefix(LENGTH_BYTES + field.size());
  }
  return header;
}

void TcprosReader::feed(std::string_view bytes)
{
  buffer_.erase(0, at_);
  at_ = 0;
  buffer_.append(bytes);
}

std::optional<std::string_view> TcprosReader::next()
{
  const std::string_view rest = std::string_view(buffer_).substr(at_);
  is_broken_ = rest.size() >= LENGTH_BYTES && lengthAt(rest) > most_bytes_;
  if (is_broken_ || rest.size() < LENGTH_BYTES || lengthAt(rest) > rest.size() - LENGTH_BYTES)
  {
    if (rest.empty())
    {
      buffer_ = std::string();
      at_ = 0;
    }
    return std::nullopt;
  }
  const std::string_view part = rest.substr(LENGTH_BYTES, lengthAt(rest));
  at_ += LENGTH_BYTES + part.size();
  return part;
}

}  // namespace pi_os_transport
