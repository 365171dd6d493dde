// A pty, FIFO or serial device by its path: opened without waiting, and again every second once it has vanished.
#pragma once

#include <cstdint>
#include <string>

namespace brov {

class Endpoint {
 public:
  enum class Direction { kIn, kBoth };

  // An empty path stands for nothing connected.
  Endpoint(std::string path, std::uint32_t baud, Direction direction)
      : path_(std::move(path)), baud_(baud), direction_(direction) {}
  ~Endpoint() { close(); }
  Endpoint(const Endpoint&) = delete;
  Endpoint& operator=(const Endpoint&) = delete;

  // A pseudo terminal of our own, whose other end has the returned name; empty if there is none to be had.
  std::string make_pty();
  void open_if_due(std::uint64_t now_us);
  void set_baud(std::uint32_t baud);

  int fd() const { return fd_; }  // -1 while closed
  // What is there now, at most `most` bytes.
  std::size_t read(std::uint8_t* into, std::size_t most, std::uint64_t now_us);
  // How many bytes were taken; the rest is lost, as on a real line that nobody listens to.
  std::size_t write(const std::uint8_t* data, std::size_t count);

 private:
  void close();
  void make_raw() const;

  std::string path_;
  std::uint32_t baud_;
  Direction direction_;
  int fd_ = -1;
  int kept_open_ = -1;  // the far end of our own pty, so that it does not hang up between two readers
  std::uint64_t retry_us_ = 0;
};

}  // namespace brov
