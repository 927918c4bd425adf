"""What follows the displacement does so once where nothing moves, and again afterwards."""

import pytest

from fenicsx_friction.obstacles.following import Follower, all_still
from models import raous


class Counted(Follower):
    """Counts how often it follows."""

    count = 0

    def _follow(self):
        self.count += 1


def test_it_follows_once_inside_and_again_outside():
    one, other = Counted(), Counted()
    one.update()
    with all_still([one, other]):
        assert (one.count, other.count) == (2, 1)
        for _ in range(3):
            one.update()
            with one.still():
                other.update()
        one.update()
        assert (one.count, other.count) == (2, 1)
    one.update()
    other.update()
    assert (one.count, other.count) == (3, 2)


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_it_follows_again_after_an_error_inside(error):
    one = Counted()
    with pytest.raises(error), all_still([one]):
        raise error
    one.update()
    assert one.count == 2


@pytest.mark.mpi
def test_gaps_are_those_of_the_displacement_after_solves_and_errors():
    model = raous(4, 2, 1.0, "followed_")
    problem, pairing = model.problem, model.contact.pairing
    heights = lambda: pairing.side.owned(problem.u.x.array)[:, 1]  # noqa: E731
    model.load(3.0, 1.0)
    for moved in (0.0, 1e-3, -1e-3):
        problem.u.x.array[:] += moved
        assert pairing.gaps() == pytest.approx(heights(), abs=1e-15)
        with pytest.raises(ZeroDivisionError), problem.terms.still():
            1 / 0  # noqa: B018
    assert problem.solve().certified
    assert pairing.gaps() == pytest.approx(heights(), abs=1e-15)
