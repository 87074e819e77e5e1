"""How long threads wait for each other, and for a GPU."""

import pytest
import warp as wp

from runout.backends import waiting
from runout.backends.waiting import CHOSEN, LONGEST, LOOPED, NAP, SPINS, wait_briefly, wait_for


def test_threads_sleep_soon_where_nobody_says_how_they_wait():
    environment = {"OMP_NUM_THREADS": "2"}
    wait_briefly(environment)
    assert environment == {"OMP_NUM_THREADS": "2", "GOMP_SPINCOUNT": str(SPINS)}


@pytest.mark.parametrize("name", CHOSEN)
def test_what_the_environment_says_of_waiting_holds(name):
    environment = {name: "1"}
    wait_briefly(environment)
    assert environment == {name: "1"}


class Event:
    """Event of a GPU that comes after a time [s], by a clock that only sleeps and looks move on."""

    def __init__(self, monkeypatch, comes):
        self.comes, self.now, self.looks, self.slept, self.ended = comes, 0.0, 0, 0.0, False
        monkeypatch.setattr(waiting.time, "perf_counter", lambda: self.now)
        monkeypatch.setattr(waiting.time, "sleep", self.sleep)
        monkeypatch.setattr(wp, "synchronize_event", self.end)

    @property
    def is_complete(self):
        self.looks, self.now = self.looks + 1, self.now + 1e-5
        return self.now >= self.comes

    def sleep(self, seconds):
        self.slept, self.now = self.slept + seconds, self.now + seconds

    def end(self, event):
        assert event is self
        self.ended = True


def test_a_thread_does_not_sleep_for_a_gpu_that_comes_soon(monkeypatch):
    event = Event(monkeypatch, 0.9 * LOOPED)
    wait_for(event)
    assert event.ended
    assert event.slept == 0


def test_a_thread_sleeps_most_of_the_time_that_a_gpu_lets_it_wait(monkeypatch):
    event = Event(monkeypatch, 0.1)
    wait_for(event)
    assert event.ended
    assert event.slept > 0.8 * (0.1 - LOOPED)
    assert event.now <= 0.1 + NAP + 1e-5


def test_the_driver_raises_the_error_of_an_event_that_never_comes(monkeypatch):
    event = Event(monkeypatch, float("inf"))
    wait_for(event)
    assert event.ended
    assert LONGEST <= event.now <= LONGEST + 2 * NAP
