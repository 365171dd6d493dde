// The loop's work as jobs that say when they next want to run.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace brov {

class Job {
 public:
  // Does what is due and tells when there is something to do again.
  virtual std::uint64_t run(std::uint64_t now_us) = 0;

 protected:
  ~Job() = default;
};

template <std::size_t Count>
class JobList {
 public:
  explicit JobList(const std::array<Job*, Count>& jobs) : jobs_(jobs) {}
  // Runs the jobs that are due, in their order; returns when the next one is.
  std::uint64_t run_due(std::uint64_t now_us) {
    std::uint64_t next_us = UINT64_MAX;
    for (std::size_t i = 0; i < Count; ++i) {
      if (now_us >= due_us_[i]) due_us_[i] = jobs_[i]->run(now_us);
      if (due_us_[i] < next_us) next_us = due_us_[i];
    }
    return next_us;
  }

 private:
  std::array<Job*, Count> jobs_;
  std::array<std::uint64_t, Count> due_us_{};
};

}  // namespace brov
