# The core as real Xtensa code, run under QEMU with the shared vectors and a whole board, and compiled for the ESP32.
XT := $(BUILD)/xtensa
XT_PREFIX := xtensa-lx106-elf-
# Its compiler brings no C++ library: the headers that the core uses are those of the host's compiler of the same version.
XT_VERSION := $(shell $(XT_PREFIX)gcc -dumpversion 2>/dev/null | cut -d. -f1)
XT_INCLUDES := -nostdinc++ -isystem /usr/include/c++/$(XT_VERSION) -isystem xtensa/include \
	-isystem /usr/include/$(shell uname -m)-linux-gnu/c++/$(XT_VERSION) -isystem /usr/lib/xtensa-lx106-elf/include
XT_FLAGS := $(COMMON) -Os -fno-exceptions -fno-threadsafe-statics -fno-use-cxa-atexit -mlongcalls -mtext-section-literals \
	-ffunction-sections -fdata-sections $(XT_INCLUDES)
XT_CORE := $(patsubst %.cpp,$(XT)/%.o,$(LIB_SOURCES) $(RIG_SOURCES))
RUNNER_SHARED := xtensa/runner.cpp xtensa/kinematics_checks.cpp xtensa/scenario.cpp xtensa/vector_checks.cpp native/i2c_models.cpp
RUNNER_FLAGS := -Ixtensa -I. -I$(BUILD)
XT_RUNNER := $(RUNNER_SHARED:%.cpp=$(XT)/%.o) $(XT)/xtensa/machine_xtensa.o $(XT)/start.o
HOST_RUNNER := $(RUNNER_SHARED:%.cpp=$(XT)/host/%.o) $(XT)/host/xtensa/machine_host.o $(CHECKED_LIB)
# Routines for floating point and 32-bit division are in the ESP8266's ROM and so not in its compiler's library.
# They are taken from Debian's source of the same compiler; nothing of it is kept here.
SOFT := divsi3 udivsi3 modsi3 umodsi3 umulsidi3 addsubdf3 muldf3 divdf3 fixdfsi fixunsdfsi fixdfdi fixunsdfdi floatsidf \
	floatdidf negdf2 cmpdf2 addsubsf3 mulsf3 divsf3 cmpsf2 negsf2 fixsfsi fixunssfsi floatsisf
SOFT_OBJECTS := $(SOFT:%=$(XT)/soft/%.o)
XT_LIBRARIES := /usr/lib/xtensa-lx106-elf/lib/libm.a /usr/lib/xtensa-lx106-elf/lib/libc.a
SOFT_SOURCE := $(XT)/libgcc/lib1funcs.S

.PHONY: xtensa libgcc-sources esp32-asm report

xtensa: $(XT)/host.txt $(XT)/qemu.txt
	cmp $^
	@cat $(XT)/qemu.txt

# One instruction takes 32 ns of the simulator's time: what counts is that its cycle counter counts instructions.
$(XT)/qemu.txt: $(XT)/runner.elf $(BUILD)/scenario.bin
	qemu-system-xtensa -M sim -cpu lx106 -display none -monitor none -serial none -semihosting \
	  -icount shift=5,align=off,sleep=off -kernel $< < $(BUILD)/scenario.bin > $@ 2> $(XT)/measured.txt \
	  || { cat $@ $(XT)/measured.txt; exit 1; }

$(XT)/host.txt: $(XT)/runner $(BUILD)/scenario.bin
	$< < $(BUILD)/scenario.bin > $@

$(BUILD)/scenario.bin: test/make_scenario.py $(wildcard ../src/bluerov_slam/simulation/raw_sensors.py)
	@mkdir -p $(@D)
	$(SCENARIO_PYTHON) $< $@

$(XT)/runner: $(HOST_RUNNER)
	$(CXX) $(COMMON) $(CHECKED) $^ -o $@

$(XT)/runner.elf: $(XT_RUNNER) $(XT_CORE) $(SOFT_OBJECTS) xtensa/simulator.ld
	$(XT_PREFIX)g++ -nostdlib -T xtensa/simulator.ld -Wl,--gc-sections -Wl,-Map=$@.map $(XT_RUNNER) $(XT_CORE) \
	  -Wl,--start-group $(SOFT_OBJECTS) $(XT_LIBRARIES) -lgcc -Wl,--end-group -o $@

$(XT)/lib/%.o: lib/%.cpp
	@mkdir -p $(@D)
	$(XT_PREFIX)g++ $(XT_FLAGS) -fcallgraph-info=su -c $< -o $@

$(XT)/xtensa/%.o: xtensa/%.cpp | $(BUILD)/vectors.h
	@mkdir -p $(@D)
	$(XT_PREFIX)g++ $(XT_FLAGS) $(RUNNER_FLAGS) -c $< -o $@

$(XT)/native/%.o: native/%.cpp
	@mkdir -p $(@D)
	$(XT_PREFIX)g++ $(XT_FLAGS) $(RUNNER_FLAGS) -c $< -o $@

$(XT)/host/%.o: %.cpp $(BUILD)/.compiler | $(BUILD)/vectors.h
	@mkdir -p $(@D)
	$(CXX) $(CHECKED_LIB_FLAGS) $(RUNNER_FLAGS) -c $< -o $@

$(XT)/start.o: xtensa/start.S
	@mkdir -p $(@D)
	$(XT_PREFIX)gcc -c $< -o $@

$(SOFT_OBJECTS): $(XT)/soft/%.o: $(SOFT_SOURCE)
	@mkdir -p $(@D)
	$(XT_PREFIX)gcc -DL_$* -I$$($(XT_PREFIX)gcc -print-file-name=plugin)/include -c $< -o $@

libgcc-sources: $(SOFT_SOURCE)

$(SOFT_SOURCE):
	@mkdir -p $(@D)
	xtensa/take_libgcc_sources $(XT_VERSION) $(@D)

# The ESP32's own code (windowed calls, hardware division, single-precision FPU): a compile check and its size. Its object
# files cannot be linked here: LLVM's assembler for this processor does not place its literals yet.
ESP32_ASM := $(patsubst %.cpp,$(XT)/esp32/%.s,$(LIB_SOURCES) $(RIG_SOURCES))
ESP32_CLANG := clang-22
ESP32_LLC := llc-22

esp32-asm: $(ESP32_ASM)
	@echo "compiled for -mcpu=esp32: $(words $^) files"

$(XT)/esp32/%.s: %.cpp
	@mkdir -p $(@D)
	$(ESP32_CLANG) --target=xtensa-none-elf $(COMMON) -Os -ffreestanding -fno-exceptions -fno-threadsafe-statics $(XT_INCLUDES) \
	  -MT $@ -emit-llvm -c $< -o $(@:.s=.bc)
	$(ESP32_LLC) -O2 -march=xtensa -mcpu=esp32 -filetype=asm $(@:.s=.bc) -o $@

report: $(XT)/qemu.txt $(ESP32_ASM)
	$(PYTHON) xtensa/report.py $(BUILD) src $(BUILD)/report.json
