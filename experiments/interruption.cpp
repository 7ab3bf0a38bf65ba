#include <kfstab/experiments/interruption.hpp>

#include <csignal>

namespace kfstab::experiments {
namespace {

volatile std::sig_atomic_t requested = 0;

extern "C" void request(int signal) {
  requested = 1;
  std::signal(signal, SIG_DFL);
}

}  // namespace

void watch_for_interruption() {
  std::signal(SIGINT, request);
  std::signal(SIGTERM, request);
}

bool interrupted() { return requested != 0; }

bool going_on() {
  if (interrupted()) throw Interrupted();
  return true;
}

}  // namespace kfstab::experiments
