// A whole board in virtual time, fed with what test/make_scenario.py wrote.
#pragma once

// Until the end of the machine's scenario input; false when a record is cut off or unknown.
// Little-endian records, one letter and its fields:
//   N  u8 n, n characters           name of the scenario that begins here
//   B  u32 baud, u8 decimation, u8 coding   a new board, at device time 0
//   F  u8 port, u16 n, n bytes      arrive before the next tick
//   I  u8 what, u8 n, n bytes       news for the I2C devices, as in docs/firmware-core.md section 7
//   T                               the next tick, a millisecond later
bool run_scenarios();
