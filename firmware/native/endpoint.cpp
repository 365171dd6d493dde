#include "endpoint.h"

#include <cerrno>
#include <cstdlib>
#include <fcntl.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

namespace brov {

namespace {

constexpr std::uint64_t kRetryUs = 1000000;

speed_t speed_of(std::uint32_t baud) { return baud == 921600 ? B921600 : baud == 115200 ? B115200 : B9600; }

bool is_fifo(int fd) {
  struct stat status {};
  return ::fstat(fd, &status) == 0 && S_ISFIFO(status.st_mode);
}

}  // namespace

std::string Endpoint::make_pty() {
  fd_ = ::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
  if (fd_ < 0 || ::grantpt(fd_) != 0 || ::unlockpt(fd_) != 0) return {};
  char name[128];
  if (::ptsname_r(fd_, name, sizeof name) != 0) return {};
  kept_open_ = ::open(name, O_RDWR | O_NOCTTY);
  make_raw();
  return name;
}

void Endpoint::open_if_due(std::uint64_t now_us) {
  if (fd_ >= 0 || path_.empty() || now_us < retry_us_) return;
  retry_us_ = now_us + kRetryUs;
  // A FIFO must not be opened for both: we would read back what we wrote.
  struct stat status {};
  const bool fifo = ::stat(path_.c_str(), &status) == 0 && S_ISFIFO(status.st_mode);
  const int mode = !fifo ? O_RDWR : direction_ == Direction::kIn ? O_RDONLY : O_WRONLY;
  fd_ = ::open(path_.c_str(), mode | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd_ >= 0) make_raw();
}

void Endpoint::set_baud(std::uint32_t baud) {
  baud_ = baud;
  make_raw();
}

std::size_t Endpoint::read(std::uint8_t* into, std::size_t most, std::uint64_t now_us) {
  if (fd_ < 0 || (direction_ == Direction::kBoth && is_fifo(fd_))) return 0;
  const ssize_t count = ::read(fd_, into, most);
  if (count > 0) return static_cast<std::size_t>(count);
  const bool nothing_yet = count < 0 && (errno == EAGAIN || errno == EINTR);
  if (!nothing_yet) {
    close();
    retry_us_ = now_us + kRetryUs;
  }
  return 0;
}

std::size_t Endpoint::write(const std::uint8_t* data, std::size_t count) {
  if (fd_ < 0 || (direction_ == Direction::kIn && is_fifo(fd_))) return 0;
  const ssize_t written = ::write(fd_, data, count);
  if (written < 0 && errno != EAGAIN && errno != EINTR) close();
  return written > 0 ? static_cast<std::size_t>(written) : 0;
}

void Endpoint::close() {
  if (fd_ >= 0) ::close(fd_);
  if (kept_open_ >= 0) ::close(kept_open_);
  fd_ = kept_open_ = -1;
}

void Endpoint::make_raw() const {
  termios settings{};
  if (::tcgetattr(fd_, &settings) != 0) return;  // no terminal
  ::cfmakeraw(&settings);
  settings.c_cflag |= CLOCAL | CREAD;
  ::cfsetspeed(&settings, speed_of(baud_));
  ::tcsetattr(fd_, TCSANOW, &settings);
}

}  // namespace brov
