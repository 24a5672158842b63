"""Others that publish lift requests: rmf-web, the demo script and rviz's panel (open-rmf.md 1.2, 1.3, 1.8). They ask once."""

from __future__ import annotations

from dataclasses import dataclass

from lift_manager.rmf.messages import AGV_MODE, DOOR_CLOSED, DOOR_OPEN, END_SESSION, LiftRequest, Time


@dataclass(frozen=True)
class RmfWeb:
    """The API server of rmf-web; it publishes on `adapter_lift_requests`."""

    node: str = "rmf_api_server"
    """Its session, whoever sits before it."""

    def request(self, lift: str, floor: str, now: float, *, request_type: int = AGV_MODE) -> LiftRequest:
        """Return what its dialog sends."""
        return LiftRequest(lift, Time.of(now), self.node, request_type, floor, DOOR_OPEN)

    def end(self, lift: str, session: str, floor: str, now: float) -> LiftRequest:
        """Return the END that its dialog can send for the session of any robot (rmf-web#808)."""
        return LiftRequest(lift, Time.of(now), session, END_SESSION, floor, DOOR_CLOSED)


def request_lift_script(lift: str, floor: str, number: int, now: float) -> LiftRequest:
    """Return what `request_lift.py` of rmf_demos publishes, straight on `lift_requests`: its request_type is END_SESSION."""
    return LiftRequest(lift, Time.of(now), f"lift_request#{number:032x}", END_SESSION, floor, DOOR_OPEN)


def panel_request(lift: str, floor: str, session: str, now: float) -> LiftRequest:
    """Return what rviz's LiftPanel publishes in manual mode: straight on `lift_requests`, past the supervisor (rmf_visualization#66)."""
    return LiftRequest(lift, Time.of(now), session, AGV_MODE, floor, DOOR_OPEN)
