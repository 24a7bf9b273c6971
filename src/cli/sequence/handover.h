#pragma once

#include <condition_variable>
#include <mutex>
#include <optional>

namespace raymeld::cli {

// Passes values from one thread to another, one at a time. Each thread waits for the other, so that no more
// values are alive than the two work on.
template <typename Value>
class Handover {
 public:
  // Waits until the value has been taken. Returns false if it was not, because this was closed.
  bool put(Value value) {
    std::unique_lock lock(mutex_);
    if (closed_) return false;
    value_ = std::move(value);
    changed_.notify_all();
    changed_.wait(lock, [&] { return !value_ || closed_; });
    return !value_;
  }

  // Waits for a value. Returns none when this is closed.
  std::optional<Value> take() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return value_ || closed_; });
    if (closed_) return std::nullopt;
    std::optional<Value> taken = std::move(value_);
    value_.reset();
    changed_.notify_all();
    return taken;
  }

  void close() {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    changed_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<Value> value_;
  bool closed_ = false;
};

// Closes a Handover at the end of a scope, also when an exception leaves it.
template <typename Value>
class ClosedAtEnd {
 public:
  explicit ClosedAtEnd(Handover<Value>& handover) : handover_(handover) {}
  ~ClosedAtEnd() { handover_.close(); }
  ClosedAtEnd(const ClosedAtEnd&) = delete;
  ClosedAtEnd& operator=(const ClosedAtEnd&) = delete;

 private:
  Handover<Value>& handover_;
};

}  // namespace raymeld::cli
