// The shared vectors and a whole board in virtual time, on any machine: what it prints must be the same everywhere.
#include "kinematics_checks.h"
#include "line.h"
#include "scenario.h"
#include "vector_checks.h"

int run() {
  const int failures = check_vectors();
  Line().text("vectors failed ").number(static_cast<std::uint64_t>(failures)).print();
  check_kinematics();
  const bool whole = run_scenarios();
  Line().text(whole ? "scenarios whole" : "scenario malformed").print();
  return failures == 0 && whole ? 0 : 1;
}
