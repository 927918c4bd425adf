# Every target runs in the environment that ./container finds or builds.
RUN = ./container
DEMO = results/raous_rectangle
PYTEST = python3 -m pytest
# Ranks of the tests that do not depend on their number.
N = 2
BENCHMARKS = block_cost deformable_cost multigrid_cost raous_cost

.PHONY: help demo docs test test-quick check serial ranks weekly benchmarks coverage lint \
	format package getfem clean

help:  ## show the targets
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' Makefile | expand -t 20

demo:  ## the first demo: Raous' rectangle with friction
	$(RUN) python3 demos/demo_raous_rectangle.py --output $(DEMO)
	@echo "Pictures and tables:"; ls -d $(DEMO)/*

test:  ## everything CI checks: style, types, tests, tests on two ranks
	$(RUN) make check RUN=

test-quick: lint  ## some minutes: short tests that together enter each room of the package
	$(RUN) $(PYTEST) -n 2 -m quick --variations 2

check: lint serial ranks  # inside the environment

# Only a test that hangs has a limit, in pyproject.toml.
serial:  ## inside the environment: tests on one rank, counts of iterations
	$(PYTEST) -n 2 --dist worksteal -m "not weekly"
	python3 benchmarks/counts.py

# On two ranks two variations of a test are enough, the first and the last: they differ in what a
# rank does alone, and `make weekly` has all. Ranks that wait yield only where there are more of
# them than cores: two on two cores were no faster with it, alone or on a busy machine.
ranks:  ## inside the environment: tests on N ranks
	mpirun -n $(N) $(PYTEST) -p no:xdist -m mpi --variations 2

weekly:  ## what takes longer: long demos, three ranks, random problems against the exact solver
	$(RUN) $(PYTEST) -m weekly
	$(RUN) env OMPI_MCA_mpi_yield_when_idle=1 mpirun --oversubscribe -n 3 $(PYTEST) -p no:xdist -m mpi
	$(RUN) python3 benchmarks/random_suite.py

benchmarks:  ## costs in linear elastic solves; tables in results/benchmarks
	mkdir -p results/benchmarks
	$(RUN) sh -c 'python3 -c "import fenicsx_friction as ff; ff.show_versions()" >results/benchmarks/versions.txt; status=0; \
	for name in $(BENCHMARKS); do python3 benchmarks/$$name.py >results/benchmarks/$$name.txt || status=1; done; exit $$status'

coverage:  ## lines of the package that `make test` runs on one rank, at least 90 %
	$(RUN) $(PYTEST) -n 2 --dist worksteal -m "not weekly" --cov --cov-report=term --cov-fail-under=90

package:  ## sdist and wheel in dist/, checked
	rm -rf dist
	$(RUN) python3 -m build --no-isolation
	$(RUN) sh -c 'twine check --strict dist/*'

docs:  ## the documentation, in docs/_build/html; the first time it runs all demos, 6 to 15 minutes
	$(RUN) python3 -m sphinx -b html -W --keep-going docs docs/_build/html
	@echo "Open docs/_build/html/index.html"

lint:  ## style and types only
	$(RUN) ruff check .
	$(RUN) ruff format --check .
	$(RUN) mypy fenicsx_friction

format:  ## rewrite the sources in the project's style
	$(RUN) ruff check --fix .
	$(RUN) ruff format .

getfem:  ## a step beside GetFEM's, which is installed for this run
	$(RUN) sh -c 'export DEBIAN_FRONTEND=noninteractive; apt-get -qq update && apt-get -qq install --no-install-recommends python3-getfem \
	>/dev/null && python3 benchmarks/getfem_raous.py'

clean:  ## remove results and caches from this folder
	rm -rf results docs/_build build dist *.egg-info .coverage* .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
