from benchmarks.endless import measure_reading, measure_staging, measure_waiting
from geoprior.geometry.camera import CamerasConfig
from geoprior.sources.endless import EndlessConfig
from geoprior.synthesis.config import GenerateConfig

GENERATE = GenerateConfig(episodes=2, seconds=2)
CAMERAS = CamerasConfig(height=16, width=16)


def waiting(**options):
    config = EndlessConfig(keep=2, workers=0)
    return measure_waiting(GENERATE, CAMERAS, config, batch_size=4, seconds=0.5, **options)


def test_a_trainer_faster_than_any_source_does_nothing_but_wait_and_a_slow_one_hardly_does():
    fast, slow = waiting(samples_per_second=1e6), waiting(samples_per_second=16.0)
    assert 0.0 <= slow["waiting_share"] < 0.5 < fast["waiting_share"] < 1.0
    assert slow["samples_per_second"] <= 16.0 < fast["samples_per_second"]
    assert slow["longest_wait_ms"] >= 0.0
    assert slow["start_seconds"] > 0.0


def test_staging_an_episode_costs_more_than_drawing_one_step_of_it():
    costs = measure_staging(GENERATE, CAMERAS, episodes=9)
    assert 0.0 < costs["drawing_ms"] < costs["staging_ms"]


def test_reading_costs_time():
    assert measure_reading(GENERATE, CAMERAS, moments=20)["reading_ms"] > 0.0
