"""One engine: handshake, reset, step, call, close.

:class:`Session` is the seam between engines and everything above. Any engine and any bridge that
implements it can be trained.
"""

from ludus.session.engine_session import EngineSession
from ludus.session.guided_session import GuidedSession
from ludus.session.interface import Session
from ludus.session.opening import LaunchOptions, open_session

__all__ = ["EngineSession", "GuidedSession", "LaunchOptions", "Session", "open_session"]
