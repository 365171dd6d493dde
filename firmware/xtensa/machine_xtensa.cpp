// The machine under QEMU: input and output through its simulator calls, instructions through the cycle counter.
#include <cstdlib>
#include <new>

#include "machine.h"

extern "C" {

extern char heap_start[], heap_end[], stack_bottom[];
typedef void (*Initializer)();
extern Initializer initializers_start[], initializers_end[];

[[noreturn]] void start_on_stack();

// Missing in the compiler's own library for this processor, whose ROM has them.
std::uint64_t __udivmoddi4(std::uint64_t numerator, std::uint64_t denominator, std::uint64_t* remainder);
std::uint64_t __umulsidi3(std::uint32_t a, std::uint32_t b);

std::uint64_t __udivdi3(std::uint64_t numerator, std::uint64_t denominator) {
  return __udivmoddi4(numerator, denominator, nullptr);
}
std::uint64_t __umoddi3(std::uint64_t numerator, std::uint64_t denominator) {
  std::uint64_t remainder = 0;
  __udivmoddi4(numerator, denominator, &remainder);
  return remainder;
}
std::int64_t __divdi3(std::int64_t numerator, std::int64_t denominator) {
  const bool negative = (numerator < 0) != (denominator < 0);
  const auto magnitude = [](std::int64_t v) {
    return v < 0 ? 0 - static_cast<std::uint64_t>(v) : static_cast<std::uint64_t>(v);
  };
  const std::uint64_t quotient = __udivdi3(magnitude(numerator), magnitude(denominator));
  return static_cast<std::int64_t>(negative ? 0 - quotient : quotient);
}
std::int64_t __muldi3(std::int64_t a, std::int64_t b) {
  const auto a_low = static_cast<std::uint32_t>(a), b_low = static_cast<std::uint32_t>(b);
  const auto a_high = static_cast<std::uint32_t>(a >> 32), b_high = static_cast<std::uint32_t>(b >> 32);
  const std::uint32_t cross = a_low * b_high + a_high * b_low;
  return static_cast<std::int64_t>(__umulsidi3(a_low, b_low) + (static_cast<std::uint64_t>(cross) << 32));
}

// Nothing is torn down: the machine stops instead.
void* __dso_handle = nullptr;
int __cxa_atexit(void (*)(void*), void*, void*) { return 0; }
void __cxa_pure_virtual() { std::abort(); }
[[noreturn]] void abort();
}

namespace {

enum Call : int { kExit = 1, kRead = 3, kWrite = 4 };
constexpr int kStandardInput = 0, kStandardOutput = 1, kStandardError = 2;
constexpr std::uint32_t kPaint = 0x5AC0FFEE;

int simulator_call(int call, int first, std::uintptr_t second, std::size_t third) {
  register int a2 asm("a2") = call;
  register int a3 asm("a3") = first;
  register std::uintptr_t a4 asm("a4") = second;
  register std::size_t a5 asm("a5") = third;
  asm volatile("simcall" : "+a"(a2), "+a"(a3) : "a"(a4), "a"(a5) : "memory");
  return a2;
}

[[noreturn]] void stop(int status) {
  for (;;) simulator_call(kExit, status, 0, 0);
}

void write_all(int file, const char* text, std::size_t length) {
  while (length != 0) {
    const int written = simulator_call(kWrite, file, reinterpret_cast<std::uintptr_t>(text), length);
    if (written <= 0) stop(3);
    text += written;
    length -= static_cast<std::size_t>(written);
  }
}

std::uint32_t cycles() {
  std::uint32_t count;
  asm volatile("rsr %0, ccount" : "=a"(count)::"memory");
  return count;
}

std::uint32_t* stack_pointer() {
  std::uint32_t* pointer;
  asm volatile("mov %0, a1" : "=a"(pointer));
  return pointer;
}

std::uint32_t* marked_top = nullptr;

}  // namespace

extern "C" [[noreturn]] void abort() {
  write_all(kStandardError, "aborted\n", 8);
  stop(4);
}

// Memory for the tables of the shared vectors, never given back. The core takes none.
void* operator new(std::size_t size) {
  static char* next = heap_start;
  char* const block = next;
  next += (size + 7) / 8 * 8;
  if (next > heap_end) abort();
  return block;
}
void operator delete(void*) noexcept {}
void operator delete(void*, std::size_t) noexcept {}
namespace std {
void __throw_length_error(const char*) { abort(); }
void __throw_bad_alloc() { abort(); }
void __throw_bad_array_new_length() { abort(); }
}  // namespace std

namespace machine {

std::size_t read_scenario(std::uint8_t* into, std::size_t most) {
  std::size_t got = 0;
  while (got < most) {
    const int count = simulator_call(kRead, kStandardInput, reinterpret_cast<std::uintptr_t>(into + got), most - got);
    if (count <= 0) break;
    got += static_cast<std::size_t>(count);
  }
  return got;
}

void print(const char* text, std::size_t length) { write_all(kStandardOutput, text, length); }
void print_measure(const char* text, std::size_t length) { write_all(kStandardError, text, length); }

std::uint32_t instructions() { return cycles(); }

void mark_stack() {
  marked_top = stack_pointer() - 64;  // what this call and its caller still use stays out of it
  for (std::uint32_t* at = reinterpret_cast<std::uint32_t*>(stack_bottom); at < marked_top; ++at) *at = kPaint;
}

std::uint32_t stack_used() {
  const std::uint32_t* at = reinterpret_cast<std::uint32_t*>(stack_bottom);
  while (at < marked_top && *at == kPaint) ++at;
  return static_cast<std::uint32_t>((marked_top - at + 64) * 4);
}

}  // namespace machine

void start_on_stack() {
  for (Initializer* initializer = initializers_start; initializer != initializers_end; ++initializer) (*initializer)();
  stop(run());
}
