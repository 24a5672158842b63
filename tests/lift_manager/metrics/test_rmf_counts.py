"""What an adapter to Open-RMF counts, read with the parser of the library: inside a manager, and beside one."""

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.parser import text_string_to_metric_families

from lift_manager.metrics.rmf import RmfCollector
from lift_manager.rmf.counts import Counts
from tests.lift_manager.metrics.measured import rig_of
from tests.lift_manager.web.fake import one_lift
from tests.lift_manager.web.fake_lifts import IDLE
from tests.support.virtual_time import run_virtual

NAME = 'a "lift"\nof two lines'


def counts() -> Counts:
    counted = Counts()
    counted.requests[NAME, "begun"] += 2
    counted.requests["", "unknown_lift"] += 1
    counted.states[NAME] += 7
    return counted


def samples(text: str) -> dict[tuple[str, ...], float]:
    return {
        (sample.name, *sample.labels.values()): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if "_rmf_" in sample.name
    }


EXPECTED = {
    ("lift_manager_rmf_requests_total", NAME, "begun"): 2,
    ("lift_manager_rmf_requests_total", "", "unknown_lift"): 1,
    ("lift_manager_rmf_states_total", NAME): 7,
}


def test_an_adapter_beside_a_manager_shows_what_it_counted() -> None:
    registry = CollectorRegistry()
    registry.register(RmfCollector(counts()))
    assert samples(generate_latest(registry).decode()) == EXPECTED


def test_the_metrics_of_a_manager_show_it_once_there_is_an_adapter_inside() -> None:
    metrics = rig_of(one_lift(IDLE)).metrics

    async def scraped() -> str:
        return (await metrics.scrape(""))[0].decode()

    assert samples(run_virtual(scraped)) == {}
    metrics.count_rmf(counts())
    assert samples(run_virtual(scraped)) == EXPECTED
