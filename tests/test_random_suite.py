"""A sample of benchmarks/random_suite.py: random problems against the exact reference."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import random_suite


@pytest.mark.parametrize("seed", range(30))
def test_random_problem_is_certified_and_exact(seed):
    outcome = random_suite.run(seed)
    assert outcome.passed, f"seed {seed}: {outcome}"
