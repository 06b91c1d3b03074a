# Every target starts with the set-up, which takes no time if nothing is missing.

CARGO ?= cargo
SCENE ?= cornell-box
FLAGS = --locked
# Packages that are built together share the features of their dependencies. `--package bdpm` alone would build all crates
# a second time, without their feature `default`.
ALL = --workspace --exclude bdpm-python

.PHONY: setup denoiser mpi build demo docs test check check-long bench memcheck check-package check-python check-notebooks wheel check-report check-mitsuba check-sizes blender check-blender nightly

setup:
	@scripts/setup.sh

# Intel Open Image Denoise for noisy renders: optional, 53 MB.
denoiser:
	@scripts/denoiser.sh

# Open MPI for `cargo build --features mpi` (docs/how-to/clusters.md): optional.
mpi: setup
	@scripts/mpi.sh

build: setup
	$(CARGO) build $(FLAGS) --release

demo: build
	@scripts/denoiser.sh || echo "images will not be denoised"
	@mkdir -p out
	$(CARGO) run $(FLAGS) --release --quiet -- \
		render scenes/$(SCENE) --output out/$(SCENE).exr --time 20s
	@echo "The image as radiance:  out/$(SCENE).exr"
	@echo "The image to look at:   out/$(SCENE).png"

# All pages with search and formulas, and rustdoc, as a site in out/docs. The tools are installed into
# target/docs-tools once; after that nothing is fetched.
docs: setup
	CARGO=$(CARGO) scripts/docs.sh

# Every family of tests has a case here. `--tests` leaves out examples and benches, which clippy compiles. The Python
# package is checked by `make check-python`.
test: setup denoiser
	$(CARGO) fmt --all --check
	$(CARGO) clippy $(FLAGS) $(ALL) --all-targets -- -D warnings
	$(CARGO) clippy $(FLAGS) $(ALL) --test check -- -D warnings
	$(CARGO) test $(FLAGS) $(ALL) --tests
	$(CARGO) test $(FLAGS) $(ALL) --doc
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc $(FLAGS) --no-deps $(ALL)

# Long statistical tables, small scenes beside the renders of Mitsuba, briefly, the program without Embree, the library
# alone, and renders by several processes. Each set of features is a build of its own, so the tests of the last two,
# which are small, run with little optimization. Mitsuba is compared with the program that the tables have built.
check: setup denoiser
	$(CARGO) test $(FLAGS) $(ALL) --test check -- --skip report:: --skip page::
	BDPM=$${CARGO_TARGET_DIR:-target}/debug/bdpm SECONDS_EACH=0.6 RUNS=3 scripts/mitsuba-check.sh --elements
	$(CARGO) clippy $(FLAGS) --package bdpm --no-default-features --features cli -- -D warnings
	$(CARGO) clippy $(FLAGS) --package bdpm --no-default-features --features paper -- -D warnings
	$(CARGO) check $(FLAGS) --package bdpm --no-default-features --lib
	$(CARGO) test $(FLAGS) --package bdpm-accel --no-default-features \
		--config 'profile.test.package.bdpm-accel.opt-level = 1'
	CARGO=$(CARGO) scripts/check-ranks.sh
	CARGO=$(CARGO) scripts/check-dependents.sh

# Every test with `#[ignore]`, all of which are in tests/check (CONTRIBUTING.md lists them): 10 minutes and more on 2
# cores. Run them every night, and after a change of an estimator or of its weights.
check-long: setup
	$(CARGO) test $(FLAGS) $(ALL) --test check -- --ignored

# Small scenes beside the renders of Mitsuba, at length; skipped where Python or the wheel of Mitsuba is missing.
check-mitsuba: build
	scripts/mitsuba-check.sh --elements

# All scenes at the sizes and times of users: exit codes, times and memory; an hour. Run it every night on a machine that
# does nothing else. `make check-sizes SIZES='--times 5 cornell-box'` renders less.
check-sizes: build
	scripts/sizes.sh $(SIZES)

# The Blender add-on, for `Preferences > Add-ons > Install` (docs/how-to/blender.md).
blender:
	@python3 scripts/blender_zip.py out/bdpm_render.zip

# Compares the add-on with Cycles, in Blender as a Python module (500 MB from PyPI); 12 minutes on 2 cores.
check-blender: build
	scripts/blender-check.sh

# The Python package as a wheel that carries Embree and the program (docs/tutorials/python.md).
wheel: setup
	scripts/wheel.sh out

# The Python package in the development build: types, stubs, tests (needs PyPI).
check-python: setup
	CARGO=$(CARGO) scripts/check-python.sh

# The wheel in a fresh environment, with its notebooks beside Mitsuba (needs PyPI).
check-notebooks: wheel
	scripts/check-notebooks.sh out/bdpm-*.whl

bench: setup
	$(CARGO) bench $(FLAGS)

# The Embree layer under valgrind: finds reads and writes outside of allocated memory.
memcheck: setup
	scripts/valgrind.sh

# The bindings as `cargo package` packs them, unpacked in another folder: tests, documentation, old headers.
check-package: setup
	scripts/check-package.sh

# The pages of a short experiment of the paper, of a render, of mixtures and of a measurement, in a browser at the
# widths of phones and desktops.
check-report: setup
	$(CARGO) test $(FLAGS) $(ALL) --test check -- report:: page::
	scripts/check-report.sh out/report-quick
	scripts/check-pages.sh page out/page
	scripts/check-pages.sh mix out/mix
	scripts/check-pages.sh measure out/measure

# All checks that are in no other of `.ci/run`, one after the other: some hours on 2 cores.
nightly: setup
	scripts/nightly.sh
