// The native program in real time, as a process of its own between pseudo terminals. Only what does not depend on the
// machine's speed is asserted.
#include <doctest/doctest.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fcntl.h>
#include <poll.h>
#include <string>
#include <sys/stat.h>
#include <sys/wait.h>
#include <termios.h>
#include <thread>
#include <unistd.h>

#include "rig.h"

using namespace brov;

namespace {

// The other end of a line: we hold the master, the program opens the slave by its name.
class Pty {
 public:
  Pty() : fd_(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)) {
    REQUIRE(fd_ >= 0);
    REQUIRE(::grantpt(fd_) == 0);
    REQUIRE(::unlockpt(fd_) == 0);
    char name[128];
    REQUIRE(::ptsname_r(fd_, name, sizeof name) == 0);
    name_ = name;
  }
  ~Pty() { ::close(fd_); }
  Pty(const Pty&) = delete;
  Pty& operator=(const Pty&) = delete;

  const std::string& name() const { return name_; }
  int fd() const { return fd_; }
  void write(const Buffer& bytes) const { CHECK(::write(fd_, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size())); }

 private:
  int fd_;
  std::string name_;
};

// The program as a child of this process.
class Program {
 public:
  explicit Program(std::vector<std::string> arguments) {
    int out[2], errors[2];
    REQUIRE(::pipe(out) == 0);
    REQUIRE(::pipe(errors) == 0);
    pid_ = ::fork();
    if (pid_ == 0) {
      ::dup2(out[1], 1);
      ::dup2(errors[1], 2);
      std::string path = "build/brov-firmware";
      std::vector<char*> argv = {path.data()};
      for (std::string& argument : arguments) argv.push_back(argument.data());
      argv.push_back(nullptr);
      ::execv(path.c_str(), argv.data());
      ::_exit(127);
    }
    ::close(out[1]);
    ::close(errors[1]);
    out_ = out[0];
    errors_ = errors[0];
  }
  ~Program() {
    if (pid_ > 0) {
      ::kill(pid_, SIGKILL);
      ::waitpid(pid_, nullptr, 0);
    }
    ::close(out_);
    ::close(errors_);
  }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  std::string line() const {
    std::string text;
    for (char c; ::read(out_, &c, 1) == 1 && c != '\n';) text += c;
    return text;
  }
  // Ends it; its exit code. What it said on stderr stands in `said`.
  int stop(int signal = SIGTERM) {
    if (signal != 0) ::kill(pid_, signal);
    char block[4096];
    for (ssize_t count; (count = ::read(errors_, block, sizeof block)) > 0;) said.append(block, static_cast<std::size_t>(count));
    int status = 0;
    ::waitpid(pid_, &status, 0);
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
  std::string said;

 private:
  pid_t pid_ = -1;
  int out_ = -1, errors_ = -1;
};

// Frames that come over a descriptor.
class Listener {
 public:
  explicit Listener(int fd) : fd_(fd) {}
  // Waits until a frame of this type has come; its payload. Fails after ten seconds.
  Buffer wait_for(std::uint8_t type) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (std::chrono::steady_clock::now() < end) {
      FrameDecoder::Frame frame;
      while (decoder_.next(frame)) {
        if (frame.type == type) return Buffer(frame.payload.data, frame.payload.data + frame.payload.size);
      }
      pollfd wanted{fd_, POLLIN, 0};
      ::poll(&wanted, 1, 100);
      std::uint8_t block[FrameDecoder::kMaxFeed];
      const ssize_t count = ::read(fd_, block, sizeof block);
      if (count > 0) decoder_.feed(Bytes(block, static_cast<std::size_t>(count)));
    }
    FAIL("no frame of type ", int{type});
    return {};
  }
  std::uint32_t errors() const { return decoder_.counters().checksum_errors + decoder_.counters().length_errors; }

 private:
  int fd_;
  FrameDecoder decoder_;
};

int open_raw(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK);
  REQUIRE(fd >= 0);
  termios settings{};
  ::tcgetattr(fd, &settings);
  ::cfmakeraw(&settings);
  ::tcsetattr(fd, TCSANOW, &settings);
  return fd;
}

}  // namespace

TEST_CASE("In real time: sensors to frames, commands to sonars, counters at the end") {
  const Pty sonar;
  Program program({"--link", "auto", "--a", sonar.name(), "--pressure-pa", "250000", "--temperature-degc", "9.5"});
  const int link = open_raw(program.line());
  Listener host(link);
  host.wait_for(0x01);
  sonar.write(ping(600));
  const Buffer bundle = host.wait_for(0x04);
  CHECK(bundle[0] == 0);
  const Buffer question = kogger_frame(0x20, {}, {3, 0, false, true});
  const Buffer command = frame_of(0x20, kogger_command(7, question));
  CHECK(::write(link, command.data(), command.size()) == static_cast<ssize_t>(command.size()));
  CHECK(host.wait_for(0x07) == Buffer{0x20, 7, 0});
  Buffer asked(question.size());
  for (int i = 0; i < 100 && ::read(sonar.fd(), asked.data(), asked.size()) <= 0; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  CHECK(asked == question);
  Buffer sensors;
  do sensors = host.wait_for(0x01);
  while (sensors[51] == 0);
  CHECK(std::abs(static_cast<int>(get_u32(sensors.data() + 44) & 0xFFFFFF) - 250000) <= 2);
  CHECK(host.errors() == 0);
  CHECK(program.stop() == 0);
  CHECK(program.said.find("sonar A: 642 bytes, 3 frames, 0 bad, 0 bytes lost, 0 pings dropped") != std::string::npos);
  ::close(link);
}

TEST_CASE("In real time: nobody reads the link, the program keeps going and is whole again when somebody does") {
  const Pty sonar;
  Program program({"--link", "auto", "--baud", "921600", "--a", sonar.name()});
  const std::string name = program.line();
  // Far more than a pseudo terminal holds.
  for (int i = 0; i < 40; ++i) {
    sonar.write(ping(3000));
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  const int link = open_raw(name);
  Listener host(link);
  host.wait_for(0x06);
  host.wait_for(0x06);
  sonar.write(ping(200));
  for (std::uint8_t type : {std::uint8_t{0x06}, std::uint8_t{0x01}}) host.wait_for(type);
  CHECK(program.stop(SIGINT) == 0);
  CHECK(program.said.find(" 0 of them not taken") == std::string::npos);
  ::close(link);
}

TEST_CASE("In real time: an input that vanishes is opened again") {
  char directory[] = "/tmp/brov-test-XXXXXX";
  REQUIRE(::mkdtemp(directory) != nullptr);
  const std::string path = std::string(directory) + "/a";
  REQUIRE(::mkfifo(path.c_str(), 0600) == 0);
  {
    Program program({"--link", "auto", "--b", path});
    const int link = open_raw(program.line());
    Listener host(link);
    for (int round = 0; round < 2; ++round) {
      const int writer = ::open(path.c_str(), O_WRONLY);
      REQUIRE(writer >= 0);
      const Buffer data = ping(300);
      CHECK(::write(writer, data.data(), data.size()) == static_cast<ssize_t>(data.size()));
      CHECK(host.wait_for(0x04)[0] == 1);
      ::close(writer);
    }
    CHECK(program.stop() == 0);
    ::close(link);
  }
  ::unlink(path.c_str());
  ::rmdir(directory);
}

TEST_CASE("Wrong arguments are explained") {
  const std::vector<std::string> wrong[] = {{}, {"--link"}, {"--baud", "9600", "--link", "auto"}, {"--depth", "3"},
                                            {"--link", "auto", "--pressure-pa", "1e5"}};
  for (const auto& arguments : wrong) {
    Program program(arguments);
    CHECK(program.stop(0) == 2);
    CHECK(program.said.find("usage:") != std::string::npos);
  }
}
