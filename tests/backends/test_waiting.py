"""How long threads wait for each other."""

import pytest

from runout.backends.waiting import CHOSEN, SPINS, wait_briefly


def test_threads_sleep_soon_where_nobody_says_how_they_wait():
    environment = {"OMP_NUM_THREADS": "2"}
    wait_briefly(environment)
    assert environment == {"OMP_NUM_THREADS": "2", "GOMP_SPINCOUNT": str(SPINS)}


@pytest.mark.parametrize("name", CHOSEN)
def test_what_the_environment_says_of_waiting_holds(name):
    environment = {name: "1"}
    wait_briefly(environment)
    assert environment == {name: "1"}
