#pragma once

#include "graph/graph_reader.h"
#include "protocol/requests.h"

#include <xmlrpcpp/XmlRpcValue.h>
#include <nlohmann/json.hpp>

namespace pi_web
{

/// A value of the parameter server. Numbers that JSON does not have (NaN, infinity) become null, binary data a note.
nlohmann::json toJson(XmlRpc::XmlRpcValue value);

/// @throws std::invalid_argument for what the parameter server cannot hold: null, integers beyond 32 bit, and values
/// that are nested more than 20 deep.
XmlRpc::XmlRpcValue fromJson(const nlohmann::json& value, int depth = 0);

/// The answer to a request; a parameter that does not exist has no value. Waits for the master. @throws std::exception
OutMessage answerTo(const request::GetParameters& request, const GraphReader& reader);
OutMessage answerTo(const request::SetParameters& request, const GraphReader& reader);

}  // namespace pi_web
