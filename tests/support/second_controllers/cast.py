"""Which second controller stands in for which lift, and how its lift is set."""

from collections.abc import Mapping
from dataclasses import dataclass

from tests.support.second_controllers.agv import TwoStopAgv
from tests.support.second_controllers.buttons import AdamPushButtons, GenericCoils
from tests.support.second_controllers.cluster import GenericCoilsCluster, GenericRegistersCluster
from tests.support.second_controllers.device import Device
from tests.support.second_controllers.handshake import Chengdu, ChengduBlock
from tests.support.second_controllers.lift import Lift
from tests.support.second_controllers.lps3 import Lps3
from tests.support.second_controllers.modules import AdamIo, MoxaE1211, MoxaE1212, MoxaE1214, Wago750, WaveshareRelay
from tests.support.second_controllers.phoenix import PhoenixBlock
from tests.support.second_controllers.registers import GenericRegisters
from tests.support.second_controllers.seer import SeerGeneric
from tests.support.second_controllers.sensors import DoorContactAndFloors, LimitsAndTwoFloors, OpenContact
from tests.support.second_controllers.thingweb import Thingweb


@dataclass(frozen=True)
class Part:
    """One lift of the cast."""

    controller: type[Device]
    sensor: type[Device] | None = None
    """The second device, called `sensor`."""
    by_key: bool = False
    """Its robot mode is on by a key."""
    in_place_sends_on: bool = False

    def devices(self, lift: Lift) -> dict[str, Device]:
        """Make the devices of one lift; the controller's name is empty."""
        devices = {"": self.controller(lift)}
        if self.sensor is not None:
            devices["sensor"] = self.sensor(lift)
        return devices


CAST: Mapping[str, Part] = {
    "generic-registers": Part(GenericRegisters),
    "generic-coils": Part(GenericCoils),
    "generic-registers-cluster": Part(GenericRegistersCluster),
    "generic-coils-cluster": Part(GenericCoilsCluster),
    "adam-pushbutton": Part(AdamPushButtons, DoorContactAndFloors),
    "adam-io": Part(AdamIo),
    "two-stop-agv": Part(TwoStopAgv, by_key=True),
    "seer-siemens-chengdu": Part(Chengdu),
    "seer-siemens-chengdu-block": Part(ChengduBlock),
    "seer-lps3-two-stop": Part(Lps3, in_place_sends_on=True),
    "seer-generic": Part(SeerGeneric),
    "robotnik-il-eth": Part(PhoenixBlock, OpenContact),
    "moxa-e1211": Part(MoxaE1211, LimitsAndTwoFloors),
    "moxa-e1212": Part(MoxaE1212),
    "moxa-e1214": Part(MoxaE1214),
    "wago-750": Part(Wago750),
    "waveshare-relay": Part(WaveshareRelay, LimitsAndTwoFloors),
    "thingweb-elevator": Part(Thingweb),
}
"""By the name of the map that describes the same lift."""
