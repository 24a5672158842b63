from __future__ import annotations

from collections.abc import Callable, Iterator

from ros_world import world

from rclpy.endpoint import Subscription
from rclpy.node import Node


class ExternalShutdownException(Exception):
    pass


class SingleThreadedExecutor:
    def __init__(self, *, context: None = None) -> None:
        self._nodes: list[Node] = []
        self._ready: Iterator[Callable[[], None]] = iter(())
        self.is_shut_down = False

    def add_node(self, node: Node) -> bool:
        self._nodes.append(node)
        return True

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        self.is_shut_down = True
        return True

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Do one callback. In virtual time the clock jumps to the next timer, or as far as the time-out."""
        call = next(self._ready, None)
        while call is None:
            if not self._wait(timeout_sec):
                return
            self._ready = iter(list(self._find()))
            call = next(self._ready, None)
        call()

    def _wait(self, timeout_sec: float | None) -> bool:
        """Return whether something may be ready; False when the time is over."""
        end = None if timeout_sec is None else world.steady() + int(timeout_sec * 1e9)
        while True:
            if not world.context_is_up:
                raise ExternalShutdownException
            if any(True for _ in self._look()):
                return True
            times = [timer.next_ns for node in self._nodes for timer in node.timers]
            if end is not None:
                times.append(end)
            if not times:
                raise AssertionError("the executor would wait for ever")
            world.pass_time(max(0, min(times) - world.steady()))
            if end is not None and world.steady() >= end and not any(True for _ in self._look()):
                return False

    def _look(self) -> Iterator[object]:
        for node in self._nodes:
            yield from (one for one in node.subscriptions if one.reader.got or _has_news(one))
            yield from (timer for timer in node.timers if timer.next_ns <= world.steady())
            yield from (guard for guard in node.guards if guard.is_triggered)

    def _find(self) -> Iterator[Callable[[], None]]:
        for node in self._nodes:
            yield from (self._event(one) for one in node.subscriptions if _has_news(one))
        for node in self._nodes:
            for timer in node.timers:
                if timer.next_ns <= world.steady():
                    timer.called()
                    yield timer.callback
            yield from (self._message(one) for one in node.subscriptions if one.reader.got)
            for guard in node.guards:
                if guard.is_triggered:
                    guard.is_triggered = False
                    yield guard.callback

    def _event(self, subscription: Subscription) -> Callable[[], None]:
        from rclpy.event_handler import QoSSubscriptionMatchedInfo

        def call() -> None:
            reader = subscription.reader
            info = QoSSubscriptionMatchedInfo(reader.ever_matched, reader.news, reader.current, reader.current_news)
            reader.news = reader.current_news = 0
            if subscription.matched is not None:
                subscription.matched(info)

        return call

    def _message(self, subscription: Subscription) -> Callable[[], None]:
        return lambda: subscription.callback(subscription.reader.got.popleft())


def _has_news(subscription: Subscription) -> bool:
    reader = subscription.reader
    return subscription.matched is not None and bool(reader.news or reader.current_news)
