"""Serves a recording to the browser in the process of the command, until it is interrupted."""

import asyncio
import threading
from collections.abc import Callable
from pathlib import Path

from rfca_rig.campaign.stored import open_stored
from rfca_rig.clock import WallClock
from rfca_rig.errors import BadInput
from rfca_rig.view.access_token import new_token
from rfca_rig.view.leg_pose import Legs
from rfca_rig.view.live_view import url_of
from rfca_rig.view.replay import Replay
from rfca_rig.view.serving import listen_on, port_of, serve


def replay(path: Path, port: int, ready: Callable[[str], None]) -> None:
    """Serves a recording until the process is interrupted.

    Parameters
    ----------
    path
        A run's folder, a recording file or a campaign.
    port
        TCP port; 0 for any free one.
    ready
        Called with the address to open, as soon as it can be opened.

    Raises
    ------
    BadInput
        Where there is no recording, none with anything to play, or for a port that is in use.
    """
    stored = open_stored(path)
    legs = Legs(stored.nominal)
    source = Replay(stored, legs, WallClock())
    if not source.player.clips:
        raise BadInput(f"{path}: holds neither strokes nor static stages, so there is nothing to view")
    listening, token = listen_on(port), new_token()
    ready(url_of(port_of(listening), token))
    # Shapes take seconds to compute; until then the page shows a straight leg.
    threading.Thread(target=legs.prepare, args=([clip.scene for clip in source.player.clips],), daemon=True).start()
    asyncio.run(serve(source, token, listening, asyncio.Event(), lambda _pages: True))
