# Sets up, builds and runs the suite on Debian 12 and 13. "make help" lists the targets.
# Everything goes to build/ and install/; the system gets only the packages of dependencies.txt.

ifneq ($(words $(CURDIR)),1)
  $(error The path "$(CURDIR)" contains a space, which catkin's generated scripts do not stand. Move the suite)
endif

.DEFAULT_GOAL := help
.NOTPARALLEL:
MAKEFLAGS += --no-print-directory

JOBS ?= $(shell nproc)
# ON compiles the sources of a library five at a time: most of the time goes to the headers that they share. OFF builds
# faster after a change of one source.
UNITY ?= ON
BUILD := $(CURDIR)/build
INSTALL := $(CURDIR)/install

# Debian's python3 and tools first: others on PATH know nothing of Debian's ROS packages.
export PATH := /usr/bin:$(PATH):/usr/sbin:/sbin
export LC_ALL := C.UTF-8
export ROS_HOSTNAME := localhost
# What a set-up file sourced earlier left behind would be taken for a workspace below this one.
unexport _CATKIN_SETUP_DIR CMAKE_PREFIX_PATH LD_LIBRARY_PATH LD_PRELOAD PKG_CONFIG_PATH PYTHONPATH ROS_PACKAGE_PATH

ifndef PI_EDGE_DATA
  ifneq ($(wildcard ../shared/data/.),)
    export PI_EDGE_DATA := $(abspath ../shared/data)
  endif
endif

.PHONY: help
help:
	@echo 'make demo         the vehicle drives from A to B in a rendered campus, over π-OS and over TCPROS; a report'
	@echo 'make demo-recording  a recording or a video through π-OS and through TCPROS, with a report'
	@echo 'make check        all tests; the last line counts them. PACKAGE=pi_slam: those of one package'
	@echo 'make test         tests whose name matches a regular expression: PATTERN=slam'
	@echo 'make soak         all tests, the statistical and soak tests in their long form'
	@echo 'make bench        π-OS beside stock TCPROS: latency, throughput, CPU, memory'
	@echo 'make bench-devices  the same between devices, which are network namespaces: needs root'
	@echo 'make bench-runtime  the runtime beside StarPU, plain OpenCL and a static map: latency, idle cost, deadlines'
	@echo "make conformance  ros_comm's own tests of roscpp and rosmaster, with π-OS preloaded, with pi_master in its place"
	@echo 'make chaos        kills nodes by the thousand and does worse to them; ARGS="--kills 10000 --seed 1 --minutes 60"'
	@echo '                  ARGS=--sweep: at every system call and every step of a link'
	@echo 'make sanitize     tests of π-OS with SANITIZER=thread or address (with undefined behaviour); ARGS="<pattern>"'
	@echo 'make fuzz         fuzzes every decoder of what peers supply, ARGS="10" minutes each; needs clang'
	@echo 'make build        missing Debian packages, Release build in build/, install space in install/, networks'
	@echo 'make image        container images of an edge node and of the vehicle, from Debian packages; IMAGES=vehicle: only'
	@echo '                  that one; needs mmdebstrap'
	@echo 'make platforms    make check and make demo in a fresh Debian of its own; ARGS="trixie": only there; needs debootstrap'
	@echo 'make deb          Debian packages in build/deb; needs debhelper and, runs lintian where there is one'
	@echo 'make release-check  two builds of the packages in two folders are bit-identical; ARGS="--packages pi_node": only'
	@echo '                  of that one; ARGS="--against build/deb": one build, beside the packages of make deb'
	@echo 'make sbom         what the suite runs with on this system: SPDX, build/pi-edge-VERSION.spdx.json'
	@echo "make networks     the detector's public networks (7.5 MB), if they are not here; make build does so as well"
	@echo 'make clean        removes build/ and install/'
	@echo 'ARGS="..." is passed on to the program that a demo, a benchmark or conformance runs; JOBS=N limits the compilers.'

.PHONY: dependencies
dependencies:
	@scripts/install_dependencies

# Configured again when the list of packages changes: a library that was missing may be there now. Another generator's
# files are removed: CMake would refuse them.
$(BUILD)/.configured: Makefile $(wildcard dependencies*.txt) | dependencies
	@mkdir -p $(BUILD)
	@grep -qs '^CMAKE_GENERATOR:INTERNAL=Ninja$$' $(BUILD)/CMakeCache.txt || rm -rf $(BUILD)/CMakeCache.txt $(BUILD)/CMakeFiles
	@launcher=$$(command -v ccache || true); \
	cmake -G Ninja -S . -B $(BUILD) -DCMAKE_BUILD_TYPE=Release -DCMAKE_INSTALL_PREFIX=$(INSTALL) \
	  -DPYTHON_EXECUTABLE=/usr/bin/python3 -DCMAKE_CXX_COMPILER_LAUNCHER=$$launcher -DCMAKE_UNITY_BUILD=$(UNITY) \
	  -DCMAKE_UNITY_BUILD_BATCH_SIZE=5
	@touch $@

.PHONY: compile
compile: $(BUILD)/.configured
	@# catkin's checks of messages always run: without anything to build they are not shown.
	@quiet=$$(ninja -C $(BUILD) -n | grep -qE '(Building|Linking|Generating|Creating) ' || echo --quiet); \
	cmake --build $(BUILD) --parallel $(JOBS) -- $$quiet

.PHONY: build
build: compile
	@scripts/install_if_changed $(CURDIR) $(BUILD) $(INSTALL)
	@scripts/fetch_networks

.PHONY: networks
networks:
	@scripts/fetch_networks

# Tests also wait, so one more runs at once than there are cores. With twice as many, some wait in vain.
TEST_JOBS ?= $(shell expr 1 + $$(nproc))
.PHONY: check
check: $(BUILD)/.configured
	@scripts/run_tests --build $(BUILD) --install $(INSTALL) --jobs $(JOBS) --test-jobs $(TEST_JOBS) \
	  --package "$(PACKAGE)" $(ARGS)

.PHONY: test
test: $(BUILD)/.configured
	@scripts/run_tests --build $(BUILD) --install $(INSTALL) --jobs $(JOBS) --test-jobs $(TEST_JOBS) \
	  --package "$(PACKAGE)" --pattern "$(PATTERN)" $(ARGS)

.PHONY: soak
soak: export PI_EDGE_SOAK := 1
soak: check

.PHONY: demo
demo: build
	@. $(INSTALL)/setup.sh && exec rosrun pi_bringup drive_campus --demo $(ARGS)

.PHONY: demo-recording
demo-recording: build
	@. $(INSTALL)/setup.sh && exec rosrun pi_bringup drive_demo $(ARGS)

# Needs mmdebstrap, which "make build" does not install.
IMAGES ?= edge vehicle
.PHONY: image
image: build
	@mkdir -p $(BUILD)/image
	@. $(INSTALL)/setup.sh && for image in $(IMAGES); do \
	  rosrun pi_offload edge_image --prefix $(INSTALL) --target $$image --control debian/control \
	    --output $(BUILD)/image $(ARGS) || exit; \
	done

# In a copy of the files, as the build leaves traces in its folder. What it needs: debian/control.
.PHONY: deb
deb:
	@exec scripts/build_packages $(BUILD)/deb $(JOBS)

# Half an hour of compiling on two cores for each build.
.PHONY: release-check
release-check:
	@exec scripts/check_release --work $(BUILD)/release --jobs $(JOBS) $(ARGS)

.PHONY: bench
bench: build
	@. $(INSTALL)/setup.sh && exec rosrun pi_os_transport bench_transport $(ARGS)

.PHONY: bench-devices
bench-devices: build
	@. $(INSTALL)/setup.sh && exec rosrun pi_os_transport bench_devices $(ARGS)

.PHONY: bench-runtime
bench-runtime: build
	@. $(INSTALL)/setup.sh && exec rosrun pi_runtime bench_runtime $(ARGS)

.PHONY: conformance
conformance: build
	@exec pi_os_transport/test/conformance/run --work $(BUILD)/conformance --jobs $(JOBS) \
	  --library $(INSTALL)/lib/libpi_os_transport.so --master $(INSTALL)/lib/pi_os_transport/pi_master $(ARGS)

# From the build space: the nodes are test programs.
.PHONY: chaos
chaos: compile
	@cmake --build $(BUILD) --parallel $(JOBS) \
	  --target pi_os_transport pi_os_transport_bench_publisher pi_os_transport_bench_transport pi_os_transport_bridge \
	  pi_os_transport_pi_core pi_os_transport_pi_master pi_os_transport_test_clock pi_os_transport_test_peer \
	  pi_os_transport_test_stop_at
	@. $(BUILD)/devel/setup.sh && exec pi_os_transport/test/chaos.py $(ARGS)

SANITIZER ?= thread
.PHONY: sanitize
sanitize: dependencies
	@mkdir -p $(BUILD)/sanitize
	@exec pi_os_transport/test/sanitize/run $(SANITIZER) $(BUILD)/sanitize/$(SANITIZER) $(JOBS) "$(ARGS)"

.PHONY: fuzz
fuzz: dependencies
	@mkdir -p $(BUILD)/fuzz
	@exec pi_os_transport/test/fuzz/run $(BUILD)/fuzz $(JOBS) $(ARGS)

# Of this system. Versions of other packages differ: make it on the system that the release is for.
.PHONY: sbom
sbom: dependencies
	@mkdir -p $(BUILD)
	@version=$$(sed -n 's|.*<version>\(.*\)</version>.*|\1|p' package.xml) && \
	scripts/make_sbom $$version $$(scripts/install_dependencies --list) >$(BUILD)/pi-edge-$$version.spdx.json && \
	ls $(BUILD)/pi-edge-$$version.spdx.json

# For each half an hour of compiling on two cores, and 6 GB. Needs root and debootstrap.
.PHONY: platforms
platforms:
	@for release in $(or $(ARGS),bookworm trixie); do test/clean_chroot.sh --release $$release || exit; done

.PHONY: clean
clean:
	rm -rf $(BUILD) $(INSTALL)
