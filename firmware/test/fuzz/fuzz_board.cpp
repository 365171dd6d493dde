// The whole board under any bytes on any input, any answers of the bus, and a host that reads when it likes.
#include "brov/board.h"
#include "fuzz_input.h"

using namespace brov;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzInput input(data, size);
  FuzzBus bus(input);
  FuzzHal<FuzzBus> hal(bus);
  Settings settings;
  settings.baud = (input.byte() & 1) != 0 ? 115200 : 921600;
  settings.decimation = static_cast<std::uint8_t>(1 + input.byte() % 8);
  settings.coding = static_cast<Coding>(input.byte() % 3);
  const std::uint64_t boot_us = (input.byte() & 1) != 0 ? 0 : (std::uint64_t{1} << 32) - 1000000;
  Board board(hal, settings, {boot_us, 1, 1});
  std::uint64_t now_us = boot_us;
  while (!input.empty()) {
    const std::uint8_t port = input.byte();
    if (port < 192) {
      board.receive(static_cast<Port>(port % 6), input.batch());
    } else {
      hal.backlog = input.word() % 1024u;
    }
    now_us += 1000 + input.pause_us();
    board.tick(now_us);
    require(board.next_wanted_us(now_us) > now_us);
  }
  return 0;
}
