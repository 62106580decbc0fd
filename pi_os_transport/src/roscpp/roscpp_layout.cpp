// The layout of the classes of roscpp whose private members this library uses (-fno-access-control). The layout is the
// same in roscpp 1.15.15 (Debian 12) and 1.17.0 (Debian 13). roscpp promises nothing about these members: another
// version may move them, or give them another meaning. If an assertion fails, compare the sources of that roscpp with
// those of a version above, member by member. Then run the tests of this package and change the numbers here.

#include <ros/callback_queue.h>
#include <ros/publication.h>
#include <ros/publisher.h>
#include <ros/publisher_link.h>
#include <ros/service_client_link.h>
#include <ros/service_manager.h>
#include <ros/service_publication.h>
#include <ros/service_server_link.h>
#include <ros/subscriber_link.h>
#include <ros/subscription.h>
#include <ros/topic_manager.h>
#include <ros/transport/transport_tcp.h>
#include <ros/transport_publisher_link.h>
#include <ros/transport_subscriber_link.h>

#include <cstddef>

#pragma GCC diagnostic push
// The classes have base classes, so the standard leaves offsetof() to the compiler. GCC and clang have it.
#pragma GCC diagnostic ignored "-Winvalid-offsetof"

// Bytes on x86-64 and on arm64, where a mutex is larger. Another machine is not checked.
#if defined(__x86_64__)
#define PI_OS_BYTES(x86_64, arm64) (x86_64)
#elif defined(__aarch64__)
#define PI_OS_BYTES(x86_64, arm64) (arm64)
#endif

#ifdef PI_OS_BYTES
#define PI_OS_SIZE(type, x86_64, arm64)                          \
  static_assert(sizeof(ros::type) == PI_OS_BYTES(x86_64, arm64), \
                "roscpp has another layout of ros::" #type ": see roscpp_layout.cpp")
#define PI_OS_MEMBER(type, member, x86_64, arm64)                          \
  static_assert(offsetof(ros::type, member) == PI_OS_BYTES(x86_64, arm64), \
                "roscpp has another layout of ros::" #type "::" #member ": see roscpp_layout.cpp")

PI_OS_SIZE(CallbackQueue, 328, 352);
PI_OS_MEMBER(CallbackQueue, callbacks_, 8, 8);
PI_OS_MEMBER(CallbackQueue, mutex_, 96, 96);
PI_OS_MEMBER(CallbackQueue, enabled_, 320, 344);

PI_OS_SIZE(Publication, 384, 416);
PI_OS_MEMBER(Publication, subscriber_links_, 248, 264);
PI_OS_MEMBER(Publication, subscriber_links_mutex_, 272, 288);

PI_OS_SIZE(Publisher, 16, 16);
PI_OS_MEMBER(Publisher, impl_, 0, 0);

PI_OS_SIZE(PublisherLink, 264, 264);
PI_OS_MEMBER(PublisherLink, parent_, 24, 24);

PI_OS_SIZE(ServiceClientLink, 80, 80);
PI_OS_MEMBER(ServiceClientLink, connection_, 24, 24);
PI_OS_MEMBER(ServiceClientLink, parent_, 40, 40);
PI_OS_MEMBER(ServiceClientLink, persistent_, 56, 56);

PI_OS_SIZE(ServiceManager, 224, 248);
PI_OS_MEMBER(ServiceManager, service_publications_, 0, 0);
PI_OS_MEMBER(ServiceManager, service_publications_mutex_, 24, 24);
PI_OS_MEMBER(ServiceManager, service_server_links_, 64, 72);
PI_OS_MEMBER(ServiceManager, service_server_links_mutex_, 88, 96);
PI_OS_MEMBER(ServiceManager, shutting_down_, 128, 144);
PI_OS_MEMBER(ServiceManager, shutting_down_mutex_, 136, 152);

PI_OS_SIZE(ServicePublication, 296, 304);
PI_OS_MEMBER(ServicePublication, client_links_, 192, 192);
PI_OS_MEMBER(ServicePublication, client_links_mutex_, 216, 216);
PI_OS_MEMBER(ServicePublication, callback_queue_, 264, 272);

PI_OS_SIZE(ServiceServerLink, 344, 352);
PI_OS_MEMBER(ServiceServerLink, connection_, 24, 24);
PI_OS_MEMBER(ServiceServerLink, persistent_, 72, 72);
PI_OS_MEMBER(ServiceServerLink, extra_outgoing_header_values_, 144, 144);
PI_OS_MEMBER(ServiceServerLink, header_written_, 192, 192);
PI_OS_MEMBER(ServiceServerLink, header_read_, 193, 193);
PI_OS_MEMBER(ServiceServerLink, call_queue_, 200, 200);
PI_OS_MEMBER(ServiceServerLink, call_queue_mutex_, 280, 280);
PI_OS_MEMBER(ServiceServerLink, current_call_, 320, 328);
PI_OS_MEMBER(ServiceServerLink, dropped_, 336, 344);

PI_OS_SIZE(SubscriberLink, 136, 136);
PI_OS_MEMBER(SubscriberLink, parent_, 24, 24);
PI_OS_MEMBER(SubscriberLink, stats_, 80, 80);

PI_OS_SIZE(Subscription, 664, 704);
PI_OS_MEMBER(Subscription, callbacks_mutex_, 160, 168);
PI_OS_MEMBER(Subscription, callbacks_, 200, 216);
PI_OS_MEMBER(Subscription, dropped_, 228, 244);
PI_OS_MEMBER(Subscription, shutting_down_, 229, 245);
PI_OS_MEMBER(Subscription, publisher_links_, 360, 392);
PI_OS_MEMBER(Subscription, publisher_links_mutex_, 384, 416);

PI_OS_SIZE(TopicManager, 288, 320);
PI_OS_MEMBER(TopicManager, subs_mutex_, 0, 0);
PI_OS_MEMBER(TopicManager, subscriptions_, 40, 48);
PI_OS_MEMBER(TopicManager, advertised_topics_mutex_, 64, 72);
PI_OS_MEMBER(TopicManager, advertised_topics_, 104, 120);

PI_OS_SIZE(TransportPublisherLink, 328, 328);
PI_OS_MEMBER(TransportPublisherLink, connection_, 264, 264);

PI_OS_SIZE(TransportSubscriberLink, 304, 312);
PI_OS_MEMBER(TransportSubscriberLink, writing_message_, 136, 136);
PI_OS_MEMBER(TransportSubscriberLink, header_written_, 137, 137);
PI_OS_MEMBER(TransportSubscriberLink, connection_, 144, 144);
PI_OS_MEMBER(TransportSubscriberLink, outbox_, 176, 176);
PI_OS_MEMBER(TransportSubscriberLink, outbox_mutex_, 256, 256);
PI_OS_MEMBER(TransportSubscriberLink, queue_full_, 296, 304);

PI_OS_SIZE(TransportTCP, 608, 616);
PI_OS_MEMBER(TransportTCP, sock_, 152, 152);
PI_OS_MEMBER(TransportTCP, cached_remote_host_, 520, 528);
PI_OS_MEMBER(TransportTCP, flags_, 560, 568);
PI_OS_MEMBER(TransportTCP, connected_host_, 568, 576);
PI_OS_MEMBER(TransportTCP, connected_port_, 600, 608);

#endif

#pragma GCC diagnostic pop
