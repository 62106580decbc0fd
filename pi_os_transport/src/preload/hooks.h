#pragma once

// The interface between the preloaded library and its roscpp companion. The preloaded library depends on the C library
// alone, so any process can load it. The companion is loaded only next to roscpp.

#include <stddef.h>
#include <stdint.h>

#include "preload/zero_copy_api.h"

// The functions of libroscpp that are replaced: id, result, linker name, parameters, arguments. Also libroscpp itself
// calls them through the dynamic linker. References are declared as pointers, and a ros::WallDuration as the register
// that holds it.
// clang-format off
#define PI_OS_HOOKS(HOOK) \
  HOOK(TOPIC_MANAGER_START, void, \
      _ZN3ros12TopicManager5startEv, \
      (void* self), (self)) \
  HOOK(TOPIC_MANAGER_PUBLISH, void, \
      _ZN3ros12TopicManager7publishERKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEERKN5boost8functionIFNS_17SerializedMessageEvEEERSB_, \
      (void* self, const void* topic, const void* serialize, void* message), (self, topic, serialize, message)) \
  HOOK(PUBLISHER_PUBLISH, void, \
      _ZNK3ros9Publisher7publishERKN5boost8functionIFNS_17SerializedMessageEvEEERS3_, \
      (const void* self, const void* serialize, void* message), (self, serialize, message)) \
  HOOK(PUBLICATION_ADD_LINK, void, \
      _ZN3ros11Publication17addSubscriberLinkERKN5boost10shared_ptrINS_14SubscriberLinkEEE, \
      (void* self, const void* link), (self, link)) \
  HOOK(CONNECTION_WRITE_HEADER, void, \
      _ZN3ros10Connection11writeHeaderERKSt3mapINSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEES7_St4lessIS7_ESaISt4pairIKS7_S7_EEERKN5boost8functionIFvRKNSH_10shared_ptrIS0_EEEEE, \
      (void* self, const void* fields, const void* written), (self, fields, written)) \
  HOOK(SUBSCRIBER_HANDLE_HEADER, bool, \
      _ZN3ros23TransportSubscriberLink12handleHeaderERKNS_6HeaderE, \
      (void* self, const void* header), (self, header)) \
  HOOK(SUBSCRIBER_ENQUEUE_MESSAGE, void, \
      _ZN3ros23TransportSubscriberLink14enqueueMessageERKNS_17SerializedMessageEbb, \
      (void* self, const void* message, bool serialized, bool no_copy), (self, message, serialized, no_copy)) \
  HOOK(PUBLISHER_INITIALIZE, bool, \
      _ZN3ros22TransportPublisherLink10initializeERKN5boost10shared_ptrINS_10ConnectionEEE, \
      (void* self, const void* connection), (self, connection)) \
  HOOK(PUBLISHER_HEADER_RECEIVED, bool, \
      _ZN3ros22TransportPublisherLink16onHeaderReceivedERKN5boost10shared_ptrINS_10ConnectionEEERKNS_6HeaderE, \
      (void* self, const void* connection, const void* header), (self, connection, header)) \
  HOOK(PUBLISHER_HANDLE_MESSAGE, void, \
      _ZN3ros22TransportPublisherLink13handleMessageERKNS_17SerializedMessageEbb, \
      (void* self, const void* message, bool serialized, bool no_copy), (self, message, serialized, no_copy)) \
  HOOK(MESSAGE_DESERIALIZE, ReturnedPointer, \
      _ZN3ros19MessageDeserializer11deserializeEv, \
      (void* self), (self)) \
  HOOK(SUBSCRIBER_TRANSPORT_TYPE, ReturnedString, \
      _ZN3ros23TransportSubscriberLink16getTransportTypeB5cxx11Ev, \
      (void* self), (self)) \
  HOOK(SUBSCRIBER_TRANSPORT_INFO, ReturnedString, \
      _ZN3ros23TransportSubscriberLink16getTransportInfoB5cxx11Ev, \
      (void* self), (self)) \
  HOOK(PUBLISHER_TRANSPORT_TYPE, ReturnedString, \
      _ZN3ros22TransportPublisherLink16getTransportTypeB5cxx11Ev, \
      (void* self), (self)) \
  HOOK(PUBLISHER_TRANSPORT_INFO, ReturnedString, \
      _ZN3ros22TransportPublisherLink16getTransportInfoB5cxx11Ev, \
      (void* self), (self)) \
  HOOK(QUEUE_ADD_CALLBACK, void, \
      _ZN3ros13CallbackQueue11addCallbackERKN5boost10shared_ptrINS_17CallbackInterfaceEEEm, \
      (void* self, const void* callback, uint64_t removal_id), (self, callback, removal_id)) \
  HOOK(QUEUE_CALL_AVAILABLE, void, \
      _ZN3ros13CallbackQueue13callAvailableENS_12WallDurationE, \
      (void* self, uint64_t timeout), (self, timeout)) \
  HOOK(QUEUE_CALL_ONE, int, \
      _ZN3ros13CallbackQueue7callOneENS_12WallDurationE, \
      (void* self, uint64_t timeout), (self, timeout)) \
  HOOK(QUEUE_DISABLE, void, \
      _ZN3ros13CallbackQueue7disableEv, \
      (void* self), (self)) \
  HOOK(SERVICE_LOOKUP, bool, \
      _ZN3ros14ServiceManager13lookupServiceERKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEERS6_Rj, \
      (void* self, const void* service, void* host, void* port), (self, service, host, port)) \
  HOOK(SERVICE_CREATE_LINK, ReturnedPointer, \
      _ZN3ros14ServiceManager23createServiceServerLinkERKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEEbS8_S8_RKSt3mapIS6_S6_St4lessIS6_ESaISt4pairIS7_S6_EEE, \
      (void* self, const void* service, bool persistent, const void* request_md5, const void* response_md5, const void* fields), \
      (self, service, persistent, request_md5, response_md5, fields)) \
  HOOK(SERVICE_INITIALIZE, bool, \
      _ZN3ros17ServiceServerLink10initializeERKN5boost10shared_ptrINS_10ConnectionEEE, \
      (void* self, const void* connection), (self, connection)) \
  HOOK(SERVICE_HEADER_RECEIVED, bool, \
      _ZN3ros17ServiceServerLink16onHeaderReceivedERKN5boost10shared_ptrINS_10ConnectionEEERKNS_6HeaderE, \
      (void* self, const void* connection, const void* header), (self, connection, header)) \
  HOOK(SERVICE_CALL, bool, \
      _ZN3ros17ServiceServerLink4callERKNS_17SerializedMessageERS1_, \
      (void* self, const void* request, void* response), (self, request, response)) \
  HOOK(SERVICE_CLEAR_CALLS, void, \
      _ZN3ros17ServiceServerLink10clearCallsEv, \
      (void* self), (self)) \
  HOOK(SERVICE_REMOVE_LINK, void, \
      _ZN3ros14ServiceManager23removeServiceServerLinkERKN5boost10shared_ptrINS_17ServiceServerLinkEEE, \
      (void* self, const void* link), (self, link)) \
  HOOK(SERVICE_HANDLE_HEADER, bool, \
      _ZN3ros17ServiceClientLink12handleHeaderERKNS_6HeaderE, \
      (void* self, const void* header), (self, header)) \
  HOOK(SERVICE_PROCESS_RESPONSE, void, \
      _ZN3ros17ServiceClientLink15processResponseEbRKNS_17SerializedMessageE, \
      (void* self, bool ok, const void* response), (self, ok, response)) \
  HOOK(TCP_CONNECT, bool, \
      _ZN3ros12TransportTCP7connectERKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEEi, \
      (void* self, const void* host, int port), (self, host, port))
// clang-format on

enum PiOsHook
{
#define PI_OS_HOOK_ID(id, type, symbol, parameters, arguments) PI_OS_##id,
  PI_OS_HOOKS(PI_OS_HOOK_ID)
#undef PI_OS_HOOK_ID
      PI_OS_HOOK_COUNT
};

#define PI_OS_SHIM_VERSION 5

/// What one thread knows about an array that is filled with zeros only to be overwritten at once.
struct PiOsZeroFill
{
  size_t longest;    ///< arrays of PI_OS_ZERO_FILL_MIN to `longest` bytes are not filled; 0: all are
  char* array;       ///< memory of the newest such array; null: none, or its fill was skipped
  size_t bytes;      ///< length of `array`
  uint64_t skipped;  ///< number of fills that were skipped
};

/// Shorter arrays are always filled: that costs less than to find out whether it is needed [B].
#define PI_OS_ZERO_FILL_MIN 65536

/// Handed to the companion once, before any replaced function runs.
struct PiOsShim
{
  uint32_t version;                     ///< PI_OS_SHIM_VERSION of the preloaded library
  const char* roscpp_path;              ///< file of the libroscpp in this process
  void* original[PI_OS_HOOK_COUNT];     ///< the functions of libroscpp
  void* replacement[PI_OS_HOOK_COUNT];  ///< set by the companion; null: the original is used

  /// From now on delete[] passes addresses in [base, base + length) to `release`.
  void (*set_pool)(const void* base, size_t length, void (*release)(void*));
  /// The next new[] of this thread calls `allocate` first; if that returns null, it uses the heap. Null ends this.
  void (*set_capture)(void* (*allocate)(size_t));
  /// State of the calling thread. While its `longest` is not 0, a memset() that clears exactly the memory that the last
  /// operator new of at most so many bytes returned does nothing.
  PiOsZeroFill* (*zero_fill)();

  const PiOsZeroCopyApi* zero_copy;  ///< set by the companion
};

/// The companion's only symbol. Returns 0 if the companion takes part, else the process stays as it is.
extern "C" int pi_os_transport_attach(PiOsShim* shim);
