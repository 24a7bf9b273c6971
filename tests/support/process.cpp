#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <system_error>

#include "support.h"

extern char** environ;

namespace raymeld::test {
namespace {

void check(int error, const std::string& doing) {
  if (error != 0) throw std::system_error(error, std::generic_category(), doing);
}

// Both ends close on exec. Only the copies that become the child's stdout and stderr stay open there.
struct Pipe {
  int read_end = -1, write_end = -1;

  Pipe() {
    int ends[2];
    check(pipe2(ends, O_CLOEXEC) == 0 ? 0 : errno, "pipe");
    read_end = ends[0], write_end = ends[1];
  }
  ~Pipe() { close(read_end), close_write_end(); }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  void close_write_end() {
    if (write_end >= 0) close(write_end);
    write_end = -1;
  }
};

std::vector<std::string> environment_with(const ProcessOptions& options) {
  std::vector<std::string> result;
  for (char** entry = environ; *entry; ++entry) {
    const std::string name(*entry, std::strcspn(*entry, "="));
    if (!options.environment.contains(name)) result.emplace_back(*entry);
  }
  for (const auto& [name, value] : options.environment) {
    if (value) result.push_back(name + "=" + *value);
  }
  return result;
}

std::vector<char*> pointers(std::vector<std::string>& strings) {
  std::vector<char*> result;
  for (std::string& s : strings) result.push_back(s.data());
  result.push_back(nullptr);
  return result;
}

pid_t spawn(std::vector<std::string> argv, const ProcessOptions& options, const Pipe& out, const Pipe& err) {
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, out.write_end, STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, err.write_end, STDERR_FILENO);
  if (!options.directory.empty()) posix_spawn_file_actions_addchdir_np(&actions, options.directory.c_str());
  posix_spawnattr_t attributes;  // a shell's background jobs ignore SIGINT, and a child would inherit that
  posix_spawnattr_init(&attributes);
  sigset_t all_signals;
  sigfillset(&all_signals);
  posix_spawnattr_setsigdefault(&attributes, &all_signals);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF);
  std::vector<std::string> environment = environment_with(options);
  pid_t pid = 0;
  const int error = posix_spawnp(&pid, argv[0].c_str(), &actions, &attributes, pointers(argv).data(),
                                 pointers(environment).data());
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  check(error, "starting " + argv[0]);
  return pid;
}

// Appends the output that is there. Returns false at the end of the stream.
bool read_some(int descriptor, std::string& text) {
  std::array<char, 4096> buffer;
  const ssize_t count = read(descriptor, buffer.data(), buffer.size());
  if (count < 0 && errno == EINTR) return true;
  check(count < 0 ? errno : 0, "reading a process's output");
  text.append(buffer.data(), size_t(count));
  return count > 0;
}

// Sends a process the signal that its options ask for, once.
class DueSignal {
 public:
  DueSignal(pid_t pid, const ProcessOptions& options)
      : pid_(pid), options_(options), pending_(options.signal != 0 || options.then) {}

  // Must be called whenever stderr has grown and when the time to wait is over.
  void send_if_due(const std::string& err) {
    if (!pending_) return;
    if (!at_ && err.find(options_.signal_after) != std::string::npos)
      at_ = Clock::now() + options_.signal_delay;
    if (!at_ || Clock::now() < *at_) return;
    if (options_.signal != 0) kill(pid_, options_.signal);
    if (options_.then) options_.then();
    pending_ = false;
  }

  // Returns null while there is no moment to wait for.
  const timespec* time_to_wait() {
    if (!pending_ || !at_) return nullptr;
    const auto left = std::max(*at_ - Clock::now(), Clock::duration(0));
    left_ = {0, 0};
    left_.tv_sec = std::chrono::duration_cast<std::chrono::seconds>(left).count();
    left_.tv_nsec = std::chrono::nanoseconds(left % std::chrono::seconds(1)).count();
    return &left_;
  }

 private:
  using Clock = std::chrono::steady_clock;

  pid_t pid_;
  const ProcessOptions& options_;
  bool pending_;
  std::optional<Clock::time_point> at_;
  timespec left_{};
};

}  // namespace

ProcessResult run_process(const std::vector<std::string>& argv, const ProcessOptions& options) {
  Pipe out, err;
  const pid_t pid = spawn(argv, options, out, err);
  out.close_write_end(), err.close_write_end();
  ProcessResult result;
  DueSignal signal(pid, options);
  std::array<pollfd, 2> streams = {{{out.read_end, POLLIN, 0}, {err.read_end, POLLIN, 0}}};
  while (streams[0].fd >= 0 || streams[1].fd >= 0) {
    signal.send_if_due(result.err);
    check(ppoll(streams.data(), streams.size(), signal.time_to_wait(), nullptr) < 0 && errno != EINTR ? errno
                                                                                                      : 0,
          "poll");
    for (pollfd& stream : streams) {
      std::string& text = &stream == &streams[0] ? result.out : result.err;
      if (stream.fd >= 0 && stream.revents != 0 && !read_some(stream.fd, text)) stream.fd = -1;
    }
  }
  int status = 0;
  while (waitpid(pid, &status, 0) < 0) check(errno == EINTR ? 0 : errno, "waiting for " + argv[0]);
  if (WIFEXITED(status)) result.exit_status = WEXITSTATUS(status);
  if (WIFSIGNALED(status)) result.signal = WTERMSIG(status);
  return result;
}

}  // namespace raymeld::test
