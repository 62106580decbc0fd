// Preloaded to a publisher, before the library under test: the first, third, fifth ... message on a topic named *race*
// stops between its sending and the moment when roscpp remembers it as the last one. It says so by an answer (see
// transport_harness.py), and goes on once a subscriber's link is born, or cannot be born before the message goes on.

#include <dlfcn.h>
#include <ros/publication.h>
#include <sched.h>
#include <unistd.h>

#include <condition_variable>
#include <fstream>
#include <mutex>
#include <string>

namespace
{

constexpr int ASLEEP_SAMPLES = 100;  // a thread that waits for less than a millisecond is not blocked

std::mutex mutex;
std::condition_variable changed;
pid_t midwife = 0;  ///< thread that adds a link; 0: none
bool born = false;

bool isRace(const std::string& topic)
{
  return topic.find("race") != std::string::npos;
}

bool isAsleep(pid_t thread)
{
  std::ifstream file("/proc/self/task/" + std::to_string(thread) + "/stat");
  const std::string text((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  const size_t name_end = text.rfind(')');
  return name_end != std::string::npos && text.substr(name_end + 2, 1) == "S";
}

void awaitBirth()
{
  std::unique_lock<std::mutex> lock(mutex);
  born = false;
  const std::string answer = "@{\"ok\": true}\n";
  if (write(STDOUT_FILENO, answer.data(), answer.size()) < 0)
  {
    return;  // the judge has ended
  }
  changed.wait(lock, [] { return midwife != 0 || born; });
  for (int asleep = 0; !born && asleep < ASLEEP_SAMPLES;)
  {
    asleep = isAsleep(midwife) ? asleep + 1 : 0;
    lock.unlock();
    sched_yield();
    lock.lock();
  }
}

template <typename Function>
Function* next(const char* symbol)
{
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, symbol));
}

}  // namespace

/// ros::TopicManager::publish(topic, serialize, message)
extern "C" void
_ZN3ros12TopicManager7publishERKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEERKN5boost8functionIFNS_17SerializedMessageEvEEERSB_(
    void* self, const std::string& topic, const void* serialize, void* message)
{
  static auto* const publish = next<void(void*, const std::string&, const void*, void*)>(
      "_ZN3ros12TopicManager7publishERKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEERKN5boost8functionIFNS_"
      "17SerializedMessageEvEEERSB_");
  publish(self, topic, serialize, message);
  static int messages = 0;
  if (isRace(topic) && ++messages % 2 == 1)
  {
    awaitBirth();
  }
}

/// ros::Publication::addSubscriberLink(link)
extern "C" void _ZN3ros11Publication17addSubscriberLinkERKN5boost10shared_ptrINS_14SubscriberLinkEEE(
    ros::Publication* self, const void* link)
{
  static auto* const add = next<void(ros::Publication*, const void*)>(
      "_ZN3ros11Publication17addSubscriberLinkERKN5boost10shared_ptrINS_14SubscriberLinkEEE");
  const auto tell = [self](pid_t thread)
  {
    if (isRace(self->getName()))
    {
      std::lock_guard<std::mutex> lock(mutex);
      midwife = thread;
      born = thread == 0;
      changed.notify_all();
    }
  };
  tell(gettid());
  add(self, link);
  tell(0);
}
