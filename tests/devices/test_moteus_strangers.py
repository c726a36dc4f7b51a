"""The vendor's own Python package, unmodified, on the other side of our codec and of our twin."""

import asyncio
import math
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any

import can
import numpy as np
import pytest
from can.interfaces.virtual import VirtualBus

from rfca_rig.contracts.motor_rig import Rotor
from rfca_rig.devices.moteus import codec
from rfca_rig.devices.moteus.codec import Mode, Read, Register, Reply, Width, Write
from rfca_rig.devices.moteus.twin import MoteusTwin, MoteusTwinSettings
from rfca_rig.devices.netft.twin import NetFtTwin, NetFtTwinSettings
from rfca_rig.twins.wires import can_wire, datagram_link
from rfca_rig.twins.world import TwinWorld

moteus = pytest.importorskip(
    "moteus", reason="the extra `third-party-clients` brings the vendor's package"
)

RESOLUTIONS = [moteus.INT8, moteus.INT16, moteus.INT32, moteus.F32]


def padded(data: bytes) -> bytes:
    """As the package's CAN transport fills a frame up."""
    return data.ljust(next(length for length in codec.FD_LENGTHS if length >= len(data)), b"\x50")


def world_of(
    bus: can.BusABC, rotor: Rotor, twin: MoteusTwinSettings | None = None
) -> tuple[MoteusTwin, TwinWorld]:
    drive = MoteusTwin(bus, twin or MoteusTwinSettings())
    return drive, TwinWorld(
        rotor, drive, NetFtTwin(datagram_link()[1], NetFtTwinSettings(), np.random.default_rng(1))
    )


@pytest.mark.parametrize("width", list(Width))
def test_its_position_command_says_to_our_codec_what_it_was_told(width: Width) -> None:
    resolution = moteus.PositionResolution()
    for name in (
        "position",
        "velocity",
        "feedforward_torque",
        "kp_scale",
        "kd_scale",
        "maximum_torque",
        "watchdog_timeout",
    ):
        setattr(resolution, name, RESOLUTIONS[width])
    told = {
        "position": 0.5,
        "velocity": -0.3,
        "feedforward_torque": 1.5,
        "kp_scale": 0.75,
        "kd_scale": 0.25,
        "maximum_torque": 3.0,
        "watchdog_timeout": 0.2,
    }
    command = moteus.Controller(id=7, position_resolution=resolution).make_position(
        **told, query=True
    )
    subframes = codec.decode(padded(command.data))
    written = {item.register: item.value for item in subframes if isinstance(item, Write)}
    assert written.pop(Register.MODE) == Mode.POSITION
    registers = (0x20, 0x21, 0x22, 0x23, 0x24, 0x25, 0x27)
    assert written.keys() == set(registers)
    for register, value in zip(registers, told.values(), strict=True):
        count = codec.units_per_count(register, width) or 1e-7
        assert written[register] == pytest.approx(
            value, abs=1.0001 * count
        )  # the package cuts off where we round
    assert Read(Register.FAULT, Width.INT8) in subframes


def test_its_stop_and_its_nan_are_ours() -> None:
    controller = moteus.Controller()
    assert codec.decode(controller.make_stop().data) == [
        Write(Register.MODE, Width.INT8, Mode.STOPPED)
    ]
    _, position = codec.decode(padded(controller.make_position(position=math.nan).data))
    assert math.isnan(position.value)


def test_its_ids_are_routed_as_ours() -> None:
    command = moteus.Controller(id=9, source_can_id=3).make_query()
    identifier = (
        command.destination | command.source << 8 | (0x8000 if command.reply_required else 0)
    )
    assert codec.route_of(identifier) == codec.Route(3, 9, wants_reply=True)


@pytest.mark.parametrize("width", list(Width))
def test_its_parser_reads_our_replies(width: Width) -> None:
    said = {
        Register.MODE: 10,
        Register.POSITION: -1.0,
        Register.VELOCITY: 2.0,
        Register.TORQUE: -4.5,
        Register.VOLTAGE: 24.0,
        Register.TEMPERATURE: 31.0,
        Register.FAULT: 0,
    }
    data = codec.encode([Reply(register, width, value) for register, value in said.items()])
    result = moteus.protocol.parse_message(
        SimpleNamespace(arbitration_id=codec.arbitration_id(codec.Route(1, 0)), data=data)
    )
    assert result.id == 1
    assert moteus.protocol.parse_reply(data) == result.values
    assert result.values == pytest.approx(
        {int(register): value for register, value in said.items()}
    )


def test_its_parser_reads_what_our_twin_says_when_its_query_asks() -> None:
    with can_wire() as (here, there):
        _, world = world_of(there, Rotor(angle_rad=math.tau * 3.25, speed_rad_s=math.tau))
        command = moteus.Controller().make_query()
        here.send(
            can.Message(
                arbitration_id=0x8001, is_extended_id=True, is_fd=True, data=padded(command.data)
            )
        )
        world.process(0.001)
        answer = here.recv(timeout=0)
        assert answer.arbitration_id == 0x100
        assert command.reply_filter(SimpleNamespace(data=answer.data))
        values = moteus.protocol.parse_reply(answer.data)
        assert values[moteus.Register.MODE] == moteus.Mode.STOPPED
        assert values[moteus.Register.POSITION] == pytest.approx(3.25)
        assert values[moteus.Register.VELOCITY] == pytest.approx(1.0)
        assert values[moteus.Register.VOLTAGE] == pytest.approx(24.0)


def talk(
    conversation: Callable[[Any], Awaitable[None]],
    rotor: Rotor,
    twin: MoteusTwinSettings | None = None,
) -> None:
    """The package's controller over its own python-can transport, with the twin's world running
    beside it, 1 ms at a time.
    """

    async def both() -> None:
        with VirtualBus(channel="moteus strangers") as there:
            _, world = world_of(there, rotor, twin)
            device = moteus.PythonCanDevice(interface="virtual", channel="moteus strangers")
            running = asyncio.create_task(carried(world))
            try:
                await asyncio.wait_for(
                    conversation(moteus.Controller(transport=moteus.Transport(device))), 20.0
                )
            finally:
                running.cancel()
                device.close()

    asyncio.run(both())


async def carried(world: TwinWorld) -> None:
    now_s = 0.0
    while True:
        now_s += 1e-3
        world.process(now_s)
        await asyncio.sleep(0)


def test_its_controller_turns_our_twin() -> None:
    rotor = Rotor(angle_rad=0.3)

    async def conversation(controller: Any) -> None:
        await controller.set_stop()
        for _ in range(300):
            state = await controller.set_position(
                position=math.nan, velocity=0.5, watchdog_timeout=math.nan, query=True
            )
        assert state.values[moteus.Register.MODE] == moteus.Mode.POSITION
        assert state.values[moteus.Register.VELOCITY] == pytest.approx(0.5, abs=5e-3)
        await controller.set_stop(query=True)

    talk(conversation, rotor)
    assert rotor.angle_rad > 0.4


def test_its_controller_learns_of_a_timeout_and_recovers_by_stopping() -> None:
    async def conversation(controller: Any) -> None:
        await controller.set_stop()
        await controller.set_position(position=math.nan, watchdog_timeout=0.05, query=True)
        for _ in range(2000):
            if (await controller.query()).values[moteus.Register.MODE] == moteus.Mode.TIMEOUT:
                break
        still = await controller.set_position(
            position=math.nan, watchdog_timeout=math.nan, query=True
        )
        assert still.values[moteus.Register.MODE] == moteus.Mode.TIMEOUT
        await controller.set_stop(query=True)
        assert (await controller.query()).values[moteus.Register.MODE] == moteus.Mode.STOPPED

    talk(conversation, Rotor())


def test_its_controller_learns_of_a_fault_with_our_code() -> None:
    async def conversation(controller: Any) -> None:
        await controller.set_position(position=math.nan, query=True)
        state = await controller.query()
        assert state.values[moteus.Register.MODE] == moteus.Mode.FAULT
        assert state.values[moteus.Register.FAULT] == 36

    talk(conversation, Rotor(), MoteusTwinSettings(arming_fault=36))
